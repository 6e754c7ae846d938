"""Files of SLAMBench 1, 2 and 3."""
