/* From the package `wire`. Written by docs/tools/wire_types.py: do not edit. */

export const LEAST_DEVIATION = 0.03;
export const LEAST_PAIRS = 3;
export const MOST_LOST = 0.5;
export const QUANTILES_95 = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.16, 2.145, 2.131, 2.12, 2.11, 2.101, 2.093, 2.086, 2.08, 2.074, 2.069, 2.064];
export const QUANTILES_99 = [63.657, 9.925, 5.841, 4.604, 4.032, 3.707, 3.499, 3.355, 3.25, 3.169, 3.106, 3.055, 3.012, 2.977, 2.947, 2.921, 2.898, 2.878, 2.861, 2.845, 2.831, 2.819, 2.807, 2.797];
export const SCHEMA_VERSION = 1;
export const SLOWDOWN_LEVEL = 0.05;
export const WIDEST_INTERVAL = 1.5;
