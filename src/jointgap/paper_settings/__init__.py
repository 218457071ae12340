"""What the paper did not say: for which settings its printed numbers come out, and which it most likely used."""
