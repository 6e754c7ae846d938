"""Design spaces: parameters, constraints, conditions, and the files that describe them."""
