"""The sepsis simulator of section 6.2, and what is known of it."""
