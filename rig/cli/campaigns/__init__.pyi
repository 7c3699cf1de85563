from .progress import CampaignProgress as CampaignProgress
from .verdicts import leak as leak
