from .hold import Stops as Stops, find_stops as find_stops
from .interruptible import Interruptible as Interruptible
from .section import Section as Section, Whole as Whole
