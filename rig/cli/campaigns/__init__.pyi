from .progress import CampaignProgress as CampaignProgress, MotionProgress as MotionProgress
from .verdicts import leak as leak
