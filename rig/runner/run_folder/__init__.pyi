from .acknowledging import acknowledge_ended as acknowledge_ended
from .archive import (
    RUNS as RUNS,
    Run as Run,
    RunError as RunError,
    is_plain as is_plain,
    prunable as prunable,
    read_run as read_run,
    remove as remove,
    run_named as run_named,
    runs_below as runs_below,
)
from .comparing import (
    ANYTHING as ANYTHING,
    Change as Change,
    Compared as Compared,
    Comparison as Comparison,
    Tolerance as Tolerance,
    compare as compare,
)
from .directory import (
    JUNIT as JUNIT,
    REPORT as REPORT,
    RESULTS as RESULTS,
    DirectoryError as DirectoryError,
    default_directory as default_directory,
    file_stem as file_stem,
    log_error as log_error,
    make_empty as make_empty,
    new_path as new_path,
    prepare_directory as prepare_directory,
    recording_names as recording_names,
)
from .journal import (
    JOURNAL as JOURNAL,
    JOURNAL_SCHEMA as JOURNAL_SCHEMA,
    Entry as Entry,
    Journal as Journal,
    JournalError as JournalError,
    is_written as is_written,
    read_journal as read_journal,
    sync as sync,
)
from .junit import write_junit as write_junit
from .keeping import MOST_HELD as MOST_HELD, FolderKeeper as FolderKeeper
from .refused import discard_refused as discard_refused
from .results import (
    drift_of as drift_of,
    findings as findings,
    leak_figures as leak_figures,
    returns_of as returns_of,
    write_results as write_results,
)
from .resuming import (
    JournalState as JournalState,
    acknowledged as acknowledged,
    begun_in as begun_in,
    changes_of as changes_of,
    check_journal as check_journal,
    fingerprint as fingerprint,
    keep_attempt as keep_attempt,
    learn_again as learn_again,
    require_journal as require_journal,
    resumable as resumable,
    unfinished_run as unfinished_run,
)
from .trend import Trend as Trend, trends_of as trends_of
