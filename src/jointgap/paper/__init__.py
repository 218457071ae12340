"""The paper (Erkaya and Uzmay 2009): its printed numbers and claims, compared with the
simulation."""
