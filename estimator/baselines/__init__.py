"""What is normal for one rig, learnt from its healthy recordings, and how it is kept.

`baseline` learns it, `learning` its noise by regime, `accepting` goes on learning from later
recordings, and `baseline_file` writes and reads it.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
