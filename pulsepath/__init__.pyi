from benchmarks.animation import (
    animate as animate,
    four_views as four_views,
    save_four_views as save_four_views,
)
from benchmarks.reports.gain import (
    Comparison as Comparison,
    compare as compare,
    verdict_of as verdict_of,
)
from benchmarks.reports.plan_report import write_report as write_report
from benchmarks.sweep import (
    Grid as Grid,
    read_setting as read_setting,
    settings_of as settings_of,
    sweep as sweep,
)
from controllers import *
from kinematics import *
from planner import *
from pulsepath import plots as plots
from pulsepath.store.read import load_plan as load_plan

__version__: str
