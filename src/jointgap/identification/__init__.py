"""Identification of missing effects: residuals, fits of candidates, decision, confirmation on
held-out data.

The modules are independent of the mechanism: `jointgap.core.candidates` defines the interface of a
model.
"""
