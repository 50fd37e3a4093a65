from jshape import klipper as klipper
from jshape.design import energy as energy
from jshape.design import insensitive as insensitive
from jshape.design import linear as linear
from jshape.design import switching as switching

__all__ = ["energy", "insensitive", "klipper", "linear", "switching"]
