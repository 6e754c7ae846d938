"""The fields of a HyperMapper scenario that have no effect here, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

READ = {
    "application_name",
    "optimization_objectives",
    "input_parameters",
    "feasible_output",
    "design_of_experiment",
    "optimization_iterations",
    "evaluations_per_optimization_iteration",
    "hypermapper_mode",
    "custom_gaussian_prior_means",
    "custom_gaussian_prior_stds",
}

_FILES = "the exploration's folder holds all files"
_OWN_METHOD = "it sets up a method of HyperMapper's"
_RESUME = "a second run in the same folder resumes the first"
_PRIOR = "no prior is estimated from a file"

REASONS = {
    **dict.fromkeys(
        (
            "log_file",
            "run_directory",
            "output_data_file",
            "output_pareto_file",
            "output_image",
            "timestamp",
            "profiling_file",
            "append_profiles",
        ),
        _FILES,
    ),
    **dict.fromkeys(
        (
            "models",
            "optimization_method",
            "acquisition_function",
            "acquisition_function_optimizer",
            "scalarization_method",
            "scalarization_key",
            "weight_sampling",
            "local_search_starting_points",
            "local_search_random_points",
            "local_search_evaluation_limit",
            "local_search_scalarization_weights",
            "epsilon_greedy_threshold",
            "normalize_inputs",
            "log_transform_output",
            "max_number_of_predictions",
            "use_c_backend",
            "evolution_population_size",
            "evolution_generations",
            "mutation_rate",
            "evolution_crossover",
            "regularize_evolution",
            "batch_size",
            "bandwidth_parameter",
            "bandwidth_n_factor",
            "model_posterior_weight",
            "model_good_quantile",
            "posterior_computation_lower_limit",
        ),
        _OWN_METHOD,
    ),
    **dict.fromkeys(
        (
            "prior_estimation_file",
            "prior_estimation_quantile",
            "estimate_multivariate_priors",
            "prior_limit_estimation_points",
        ),
        _PRIOR,
    ),
    **dict.fromkeys(("resume_optimization", "resume_optimization_data"), _RESUME),
    **dict.fromkeys(
        ("verbose_logging", "profiling", "number_of_cpus", "print_best", "print_posterior_best"),
        "it concerns how HyperMapper runs",
    ),
    "print_parameter_importance": "the plots show it",
    "noise": "measurements may always be noisy",
    "number_of_repetitions": "a configuration is measured once; ask for repeats instead",
    "time_budget": "the budget counts evaluations",
    "bounding_box_limits": "they are wishes, not limits: give limits instead",
}

_LEARNT = "failures are always learnt from"
SECTIONS: dict[str, dict[str, str | None]] = {  # their fields, with the reason for no effect
    "design_of_experiment": {
        "number_of_samples": None,
        "doe_type": "the search method has a design of its own",
    },
    "feasible_output": {
        "name": None,
        "true_value": None,
        "false_value": None,  # every value except true is false
        "enable_feasible_predictor": _LEARNT,
        "enable_feasible_predictor_grid_search_on_recall_and_precision": _LEARNT,
        "feasible_predictor_grid_search_validation_file": _LEARNT,
        "feasibility_threshold": _LEARNT,
    },
    "hypermapper_mode": {
        "mode": None,
        "exhaustive_search_file": None,
    },
}

_UNKNOWN = "no such field is known"
_PARAMETER_READ = {
    "parameter_type",
    "values",
    "parameter_default",
    "constraints",
    "dependencies",
    "transform",
    "prior",
    "custom_gaussian_prior_means",
    "custom_gaussian_prior_stds",
}


def notes_on(description: Mapping[str, Any]) -> list[str]:
    """Return sentences on the fields of a scenario, and of its parameters, that are ignored or unknown."""
    ignored: dict[str, list[str]] = {}
    for field in description:
        if field not in READ:
            ignored.setdefault(REASONS.get(field, _UNKNOWN), []).append(field)
    for section, fields in SECTIONS.items():
        for field in description.get(section) or ():
            if reason := fields.get(field, _UNKNOWN):
                ignored.setdefault(reason, []).append(f"{field} of {section}")
    for name, item in description["input_parameters"].items():
        if item.get("prior") == "estimate":
            ignored.setdefault(_PRIOR, []).append(f"prior of {name}")
        for field in item:
            if field not in _PARAMETER_READ:
                ignored.setdefault(_UNKNOWN, []).append(f"{field} of {name}")
    return [
        f"{', '.join(names)} {'has' if len(names) == 1 else 'have'} no effect: {reason}"
        for reason, names in ignored.items()
    ]
