from .animate import animate as animate
from .stills import four_views as four_views, save_four_views as save_four_views
