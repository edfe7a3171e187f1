from .comparison import (
    Comparison as Comparison,
    ComparisonRow as ComparisonRow,
    SettingEntry as SettingEntry,
    compare as compare,
)
from .condition import (
    Change as Change,
    Condition as Condition,
    Judgement as Judgement,
    describe_unjudged as describe_unjudged,
    guard as guard,
    judge as judge,
    list_regressions as list_regressions,
    read_condition as read_condition,
)
from .verdict import (
    Verdict as Verdict,
    verdict_of as verdict_of,
)
