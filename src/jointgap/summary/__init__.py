"""What came out of a scenario, for those who design the mechanism: lengths, gain, price, remarks, on one page."""
