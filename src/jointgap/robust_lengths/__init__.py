"""Lengths of crank and rod that stay good however what is uncertain turns out: searched, judged on fresh draws."""
