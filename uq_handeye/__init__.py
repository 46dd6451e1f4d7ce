from .motions import Motions, relative_motions
from .noise import PairNoise, PoseNoise
from .poses import PosePairs
from .procrustes import orthonormalise, register, solve
from .propagation import propagate
