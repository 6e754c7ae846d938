"""`frontrunner paper`: the figures and tables of Nardi et al. 2017, measured on this machine."""
