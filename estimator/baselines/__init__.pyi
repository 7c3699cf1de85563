from .accepting import accepted_onto as accepted_onto
from .baseline import (
    LEAST_LEARNING_S as LEAST_LEARNING_S,
    Accepted as Accepted,
    Baseline as Baseline,
    BaselineError as BaselineError,
    learn_baseline as learn_baseline,
)
from .baseline_file import (
    baseline_doubt as baseline_doubt,
    baseline_of as baseline_of,
    content_of as content_of,
    load_baseline as load_baseline,
    write_baseline as write_baseline,
)
