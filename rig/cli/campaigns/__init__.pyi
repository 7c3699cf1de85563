from .progress import (
    CampaignProgress as CampaignProgress,
    MotionProgress as MotionProgress,
    leak as leak,
)
