"""What a refused recording says."""

import pickle

from rig.recording import MAX_PROBLEMS, RecordingError, RecordingProblem

GAP = RecordingProblem(
    "a.csv", "time_s", "gap of 12 ms", "split it here", "expected step 1 ms", 513
)


def test_a_problem_is_one_line_with_place_field_value_limit_and_remedy() -> None:
    assert str(GAP) == "a.csv:513: time_s: gap of 12 ms (expected step 1 ms); split it here"


def test_a_problem_of_the_whole_file_has_no_line() -> None:
    assert str(RecordingProblem("a.csv", "file", "empty", "fetch it")) == (
        "a.csv: file: empty; fetch it"
    )


def test_every_problem_is_reported_on_a_line_of_its_own() -> None:
    error = RecordingError([GAP, GAP])
    assert str(error) == f"{GAP}\n{GAP}"
    assert error.problems == [GAP, GAP]


def test_a_file_with_too_many_problems_is_cut_short_and_the_rest_counted_file_by_file() -> None:
    other = RecordingProblem("b.csv", "header", "not text", "save as UTF-8", line=1)
    error = RecordingError([GAP] * (MAX_PROBLEMS + 7) + [other])
    assert error.problems == [GAP] * MAX_PROBLEMS + [other]
    assert str(error).splitlines()[-1] == "a.csv: ... and 7 more problems"


def test_a_refusal_survives_the_way_back_from_another_process() -> None:
    error = pickle.loads(pickle.dumps(RecordingError([GAP] * (MAX_PROBLEMS + 1))))
    assert (error.problems, error.omitted) == ([GAP] * MAX_PROBLEMS, {"a.csv": 1})
