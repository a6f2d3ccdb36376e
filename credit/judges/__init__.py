"""What says how good a policy is."""

from credit.judges.choose import judge as judge
