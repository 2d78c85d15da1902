"""Colours that can be told apart on white, on black, and by eyes that do not see all colours.

The set of Okabe and Ito (jfly.uni-koeln.de/color), less its yellow, which white paper swallows.
"""

BLUE = "#2482c4"
ORANGE = "#d55e00"
GREEN = "#009e73"
PURPLE = "#b0609a"
SKY = "#56b4e9"
AMBER = "#d99200"
GREY = "#8a929c"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, AMBER, SKY, GREY)
