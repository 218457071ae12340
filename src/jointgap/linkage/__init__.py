"""Any planar linkage of one degree of freedom: topology, and its equations once in plain Python."""
