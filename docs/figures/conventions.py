"""The pictures of docs/explanation/conventions.md.

    python docs/figures/conventions.py [FOLDER]

Writes eye_in_hand.svg, eye_to_hand.svg, motions.svg and perturbations.svg to FOLDER, docs/images if left out. Flat
sketches of a rig: every frame is a pair of axes x and z, and every arrow `a_T_b` starts at frame a and ends at frame b.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Polygon, Rectangle

from uq_handeye.core.presentation.ellipses import render
from uq_handeye.read import write_files

MEASURED, UNKNOWN, CONSTANT, INK = "#0072B2", "#D55E00", "#5F5F5F", "#222222"


def direction(angle: float) -> np.ndarray:
    """Unit vector at an angle in degrees."""
    return np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])


def panel(axes: Axes, title: str, xlim: tuple[float, float], ylim: tuple[float, float]) -> None:
    axes.set(xlim=xlim, ylim=ylim, aspect="equal")
    axes.axis("off")
    axes.set_title(title, fontsize=11, loc="left", color=INK)


def frame(axes: Axes, at: np.ndarray, angle: float, name: str, label: tuple[float, float], colour: str = INK) -> None:
    """Axes x (solid head) and z of a frame whose x axis points to ``angle``; its name at an offset."""
    for turn, axis in ((0.0, "x"), (90.0, "z")):
        end = at + 0.55 * direction(angle + turn)
        axes.add_patch(FancyArrowPatch(at, end, arrowstyle="-|>", mutation_scale=9, lw=1.4, color=colour, zorder=5))
        axes.text(
            *(at + 0.72 * direction(angle + turn)), axis, fontsize=8, ha="center", va="center", color=colour, zorder=7,
            bbox={"facecolor": "white" if name else "none", "edgecolor": "none", "pad": 0.4},
        )  # fmt: skip
    axes.add_patch(Circle(at, 0.055, color=colour, zorder=6))
    if name:
        axes.text(*(at + label), name, fontsize=9.5, ha="center", va="center", color=colour, weight="bold")


def transform(
    axes: Axes, start: np.ndarray, end: np.ndarray, text: str, where: tuple[float, float], colour: str, bend: float
) -> None:
    """The arrow of a pose, with its name at an offset from the middle."""
    style = (0, (5, 2)) if colour == CONSTANT else "solid"
    width = 2.4 if colour == UNKNOWN else 1.6
    axes.add_patch(
        FancyArrowPatch(
            start, end, connectionstyle=f"arc3,rad={bend}", arrowstyle="-|>", mutation_scale=13, lw=width,
            linestyle=style, color=colour, shrinkA=7, shrinkB=7, zorder=4,
        )
    )  # fmt: skip
    axes.text(
        *((start + end) / 2 + where), text, fontsize=9, ha="center", va="center", color=colour, zorder=7,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
    )  # fmt: skip


def arm(axes: Axes, joints: list[tuple[float, float]]) -> None:
    """The robot as a thick grey line, with a foot."""
    points = np.array(joints)
    axes.add_patch(Rectangle(points[0] - (0.45, 0.3), 0.9, 0.3, color="#D5D5D5", zorder=1))
    axes.plot(*points.T, color="#D5D5D5", lw=11, solid_capstyle="round", solid_joinstyle="round", zorder=1)


def camera_body(axes: Axes, at: np.ndarray, angle: float) -> None:
    """A box that looks along ``angle``, with its field of view."""
    view, across = direction(angle), direction(angle + 90)
    box = [at - 0.45 * view + s * 0.22 * across for s in (1, -1)] + [at + s * 0.22 * across for s in (-1, 1)]
    axes.add_patch(Polygon(box, facecolor="#BDBDBD", edgecolor="none", zorder=2))
    axes.add_patch(
        Polygon([at, at + 1.3 * direction(angle + 22), at + 1.3 * direction(angle - 22)], color="#F0F0F0", zorder=0)
    )


def board(axes: Axes, at: np.ndarray, angle: float) -> None:
    """A checkerboard seen from its edge, along ``angle`` from ``at``."""
    along, normal = direction(angle), direction(angle - 90)
    for k in range(6):
        corner = at + (0.22 * k - 0.11) * along
        box = [corner, corner + 0.22 * along, corner + 0.22 * along + 0.12 * normal, corner + 0.12 * normal]
        axes.add_patch(Polygon(box, facecolor="#333333" if k % 2 else "white", edgecolor="#333333", lw=0.6, zorder=2))


def eye_in_hand() -> Figure:
    """Draw the content of the files, X, and the pose that stays the same, with the camera on the gripper."""
    figure = Figure(figsize=(5.6, 4.1), layout="constrained", facecolor="white")
    hand = figure.subplots()
    base, gripper, camera, target = (np.array(p) for p in ((0.0, 0.0), (2.2, 3.0), (3.6, 2.75), (4.6, -0.1)))
    panel(hand, "eye-in-hand: the camera sits on the gripper", (-1.2, 6.6), (-0.9, 4.3))
    arm(hand, [(0, 0), (-0.1, 1.7), (1.1, 3.1), (2.2, 3.0)])
    hand.plot(*np.array([gripper, camera + np.array([-0.1, 0.25])]).T, color="#D5D5D5", lw=5, zorder=1)
    camera_body(hand, camera, -70)
    board(hand, target, 0)
    frame(hand, base, 0, "base", (-0.55, 0.35))
    frame(hand, gripper, -15, "gripper", (0.0, 1.0))
    frame(hand, camera, 200, "camera", (0.75, 0.45))
    frame(hand, target, 0, "target", (1.1, 0.35))
    transform(hand, base, gripper, "base_T_gripper\n(robot file)", (0.55, -0.35), MEASURED, 0.12)
    transform(hand, gripper, camera, "X = gripper_T_camera", (1.0, 0.85), UNKNOWN, -0.45)
    transform(hand, camera, target, "camera_T_target\n(camera file)", (0.75, 0.15), MEASURED, -0.1)
    transform(hand, base, target, "W = base_T_target, constant", (0.0, -0.55), CONSTANT, 0.13)

    return figure


def eye_to_hand() -> Figure:
    """The same with a camera that stands still."""
    figure = Figure(figsize=(5.6, 4.1), layout="constrained", facecolor="white")
    world = figure.subplots()
    base, gripper, camera, target = (np.array(p) for p in ((0.0, 0.0), (2.2, 2.3), (5.4, 3.4), (3.0, 1.75)))
    panel(world, "eye-to-hand: the camera stands still, the target moves", (-1.2, 6.6), (-0.9, 4.3))
    arm(world, [(0, 0), (-0.3, 1.7), (0.9, 2.9), (2.2, 2.3)])
    world.plot([5.85, 5.85], [-0.3, 3.6], color="#D5D5D5", lw=7, zorder=0)
    camera_body(world, camera, 212)
    board(world, target, -65)
    frame(world, base, 0, "base", (-0.55, 0.35))
    frame(world, gripper, 65, "gripper", (-0.45, 0.8))
    frame(world, camera, 122, "camera", (0.45, 0.65))
    frame(world, target, -65, "target", (1.0, -0.65))
    transform(world, base, gripper, "base_T_gripper\n(robot file)", (0.1, -0.1), MEASURED, 0.12)
    transform(world, base, camera, "X = base_T_camera", (1.9, -1.35), UNKNOWN, 0.5)
    transform(world, camera, target, "camera_T_target\n(camera file)", (0.7, -0.3), MEASURED, -0.1)
    transform(world, gripper, target, "W = gripper_T_target,\nconstant", (0.95, 1.05), CONSTANT, -0.6)
    return figure


def motions() -> Figure:
    """Two poses of an eye-in-hand rig and the motions A and B between them."""
    figure = Figure(figsize=(7.4, 4.4), layout="constrained", facecolor="white")
    axes = figure.subplots()
    panel(axes, "two poses i, j: A X = X B", (-0.9, 7.3), (-0.75, 4.6))
    first, second = np.array([0.6, 2.9]), np.array([5.0, 3.1])
    hold = np.array([0.9, -0.75])
    cameras = first + hold, second + hold
    target = np.array([3.4, -0.1])
    board(axes, target, 0)
    frame(axes, first, 10, "gripper at j", (-0.55, 1.05))
    frame(axes, second, 10, "gripper at i", (0.3, 1.05))
    frame(axes, cameras[0], 190, "camera at j", (-1.0, -0.45))
    frame(axes, cameras[1], 190, "camera at i", (0.85, 0.2))
    frame(axes, target, 0, "target", (-0.75, 0.1))
    transform(axes, first, second, "A = inv(G$_j$) G$_i$, from the robot file", (0.0, 0.65), MEASURED, -0.15)
    transform(axes, cameras[0], cameras[1], "B = C$_j$ inv(C$_i$), from the camera file", (0.0, 0.42), MEASURED, -0.08)
    transform(axes, first, cameras[0], "X", (0.22, 0.12), UNKNOWN, 0.0)
    transform(axes, second, cameras[1], "X", (0.22, 0.12), UNKNOWN, 0.0)
    transform(axes, cameras[0], target, "C$_j$", (-0.3, -0.12), CONSTANT, 0.1)
    transform(axes, cameras[1], target, "C$_i$", (0.3, -0.12), CONSTANT, -0.1)
    return figure


def perturbations() -> Figure:
    """The same (theta, tau) in three conventions of errors."""
    figure = Figure(figsize=(10.2, 3.7), layout="constrained", facecolor="white")
    theta, tau = 25.0, np.array([0.9, 0.0])
    origin, at, angle = np.zeros(2), np.array([2.3, 1.0]), 50.0
    turn = np.array([direction(theta), direction(theta + 90)]).T
    own = np.array([direction(angle), direction(angle + 90)]).T
    cases = (
        ("toolkit, ROS\nR = exp(θ) R, t = t + τ", at + tau, "turns about its own origin", "parent's"),
        ("left twist of SE(3)\nT = Exp(ξ) T", turn @ at + tau, "swings about the parent's origin", "parent's"),
        ("right twist of SE(3): GTSAM, manif\nT = T Exp(ξ)", at + own @ tau, "turns about its own origin", "child's"),
    )
    for axes, (title, end, turning, whose) in zip(figure.subplots(1, 3), cases, strict=True):
        panel(axes, title, (-0.7, 4.4), (-1.2, 2.9))
        frame(axes, origin, 0, "parent", (0.0, -0.35))
        frame(axes, at, angle, "", (0, 0), "#9A9A9A")
        frame(axes, end, angle + theta, "", (0, 0), UNKNOWN)
        if "left" in title:  # first the swing, then the shift
            radius, start = float(np.hypot(*at)), np.degrees(np.arctan2(at[1], at[0]))
            arc = np.array([radius * direction(a) for a in np.linspace(start, start + theta, 30)])
            axes.plot(*arc.T, color=MEASURED, lw=1.5, zorder=3)
            axes.plot(*np.array([origin, at]).T, *np.array([origin, arc[-1]]).T, color=MEASURED, lw=0.7, ls=":")
            shift, angle_at = arc[-1], origin + 1.0 * direction(start + theta / 2)
        else:
            shift, angle_at = at, end + 0.95 * direction(angle + theta / 2)
            axes.plot(*np.array([end, end + 0.9 * direction(angle)]).T, color="#9A9A9A", lw=0.9, ls=":")
        arrow = FancyArrowPatch(shift, end, arrowstyle="-|>", mutation_scale=11, lw=1.8, color=MEASURED, zorder=4)
        axes.add_patch(arrow)
        axes.text(
            *((shift + end) / 2 + np.array([0.12, -0.25])), "τ", fontsize=12, color=MEASURED, ha="center", va="center"
        )
        axes.text(*angle_at, "θ", fontsize=12, color=MEASURED, ha="center", va="center")
        words = f"{turning},\nangle and shift along the {whose} axes"
        axes.text(1.85, -0.95, words, fontsize=9, ha="center", va="center", color=INK)
    return figure


FIGURES = {"eye_in_hand": eye_in_hand, "eye_to_hand": eye_to_hand, "motions": motions, "perturbations": perturbations}


def main(folder: Path) -> None:
    """Write the pictures."""
    write_files(folder, {f"{name}.svg": render(figure(), "svg") for name, figure in FIGURES.items()})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1] / "images")
