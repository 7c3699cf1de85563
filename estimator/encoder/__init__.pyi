from .drift_test import DriftTest as DriftTest
from .records import EncoderDrift as EncoderDrift
