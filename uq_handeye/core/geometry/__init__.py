"""SE(3) with the one error convention, frames, checks of transforms, layouts of small matrices."""
