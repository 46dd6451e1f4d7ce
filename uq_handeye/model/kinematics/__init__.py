"""Forward kinematics of a serial arm, its derivatives, and the errors of its geometry, transmissions and elasticity."""

from . import sentences as sentences
