"""The toy advertiser of section 6.1, and what is known of it."""
