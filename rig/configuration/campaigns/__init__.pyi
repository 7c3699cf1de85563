from .campaign import (
    CampaignFile as CampaignFile,
    load_campaign as load_campaign,
    plain as plain,
    read_campaign as read_campaign,
)
from .criteria import (
    CriterionFile as CriterionFile,
    OwnFigureFile as OwnFigureFile,
    bounds_of as bounds_of,
    read_criteria as read_criteria,
    read_own_figures as read_own_figures,
)
from .dry_run import (
    PlannedTest as PlannedTest,
    criterion_in_words as criterion_in_words,
    limit_in_words as limit_in_words,
    plan_campaign as plan_campaign,
    valve_speed as valve_speed,
)
from .following import expected_following as expected_following
from .judged_controls import (
    Expected as Expected,
    expected_error as expected_error,
    is_mistaken as is_mistaken,
    unstable_controls as unstable_controls,
)
from .leak_tests import LEAK_TEST_HZ as LEAK_TEST_HZ, foreseen_leaks as foreseen_leaks
from .limits import TestLimitFile as TestLimitFile, read_test_limits as read_test_limits
from .loop_of_test import (
    control_for as control_for,
    control_of as control_of,
    gain_for as gain_for,
    with_load as with_load,
)
from .schedule import (
    Entry as Entry,
    Missed as Missed,
    Schedule as Schedule,
    ScheduleFile as ScheduleFile,
    load_schedule as load_schedule,
    read_schedule as read_schedule,
)
from .segments import (
    Motion as Motion,
    SegmentFile as SegmentFile,
    Times as Times,
    context_of as context_of,
    read_motion as read_motion,
)
from .setpoints import (
    Level as Level,
    LevelField as LevelField,
    check_unmixed as check_unmixed,
    schema_of as schema_of,
    typed_files as typed_files,
)
