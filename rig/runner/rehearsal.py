"""What a campaign on hardware needs compiled, compiled before anything moves.

The compiler keeps the interpreter's lock for seconds: a supervisor that compiled during a test
would fall silent, and the rig would trip.
"""

from dataclasses import replace
from typing import Final

from estimator.filters import start_memory
from faults.campaign import Campaign
from rig.configuration.rig import Rig
from rig.loop.decision_post import prepare

from .judging import Judge
from .simulated_bench import loop_of

REHEARSED_S: Final = 12.0
"""Long enough for the detector to weigh faults against each other."""


def rehearse(campaign: Campaign, rig: Rig) -> None:
    """Judge the first seconds of a campaign's first test on a simulated rig, and forget it."""
    test = replace(campaign.tests[0], duration_s=REHEARSED_S, settle_s=0.1)
    memory = start_memory(campaign.filter_name, campaign.model, rig.sensors)
    # Nothing moves that could be hurt, and it is to come to its end.
    loop = loop_of(rig, test, memory, campaign.model, judged=False)
    judge = Judge(campaign.detector(), memory, loop.channels)
    while loop.ticks_left:
        judge.take(loop.advance(judge.ticks_due))
    judge.finish()
    prepare()
