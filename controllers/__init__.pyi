from .laws.registry import find_law as find_law, law_names as law_names
from .metrics import Metrics as Metrics, evaluate as evaluate
from .rig import Rig as Rig
from .rig_file import load_rig as load_rig, rig_names as rig_names
from .tracking import Tracking as Tracking, track as track
