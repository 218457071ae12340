"""Thousands of designs: drawn, simulated, measured, and what is learnt from them."""
