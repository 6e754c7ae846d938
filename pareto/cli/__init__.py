"""The command line: `python -m pareto explore`, `front`, `plot` and the others."""
