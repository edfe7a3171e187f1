from .comparison import (
    Comparison as Comparison,
    ComparisonRow as ComparisonRow,
    SettingEntry as SettingEntry,
    compare as compare,
)
from .verdict import (
    Condition as Condition,
    Verdict as Verdict,
    read_condition as read_condition,
    verdict_of as verdict_of,
)
