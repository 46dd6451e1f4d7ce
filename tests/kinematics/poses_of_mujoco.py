"""MJCF models, and poses of their bodies and sites by MuJoCo, stored for the test of its reader. Run by hand:

pip install mujoco==4.0.0
python tests/kinematics/poses_of_mujoco.py
"""

import json
from pathlib import Path

import numpy as np

G = '<geom size="0.01"/>'
# Degrees, classes, several joints in a body, anchors, reference values, a frame, a site.
CLASSES = f"""<mujoco model="classes">
<default><joint axis="0 1 0" range="-150 150"/><site euler="0 0 90"/>
  <default class="wrist"><joint axis="1 0 0" pos="0.01 0.02 -0.03"/>
    <default class="slow"><joint range="-45 60" ref="20"/></default></default>
  <default class="rail"><joint type="slide" range="-0.2 0.5" ref="0.1" axis="1 1 0"/></default></default>
<worldbody><body name="foot" pos="0.1 -0.2 0.3" euler="10 -20 30">{G}
  <body name="cart" axisangle="0 1 1 40" pos="0 0 0.2">{G}<joint name="rail" class="rail"/>
  <body name="shoulder" pos="0 0.1 0.2" quat="0.9 0.1 -0.3 0.2">{G}<joint name="pan"/>
      <joint name="lift" axis="0 0 -2" pos="0.05 0 0.1" limited="false"/>
    <frame pos="0 0 0.3" euler="0 45 0"><frame pos="0.1 0 0" childclass="wrist">
      <body name="elbow" zaxis="0.2 -0.3 0.8">{G}<joint name="flex"/>
        <body name="hand" xyaxes="1 0.1 0 0 1 0.4" pos="0.2 0 0">{G}<joint name="roll" class="slow"/>
          <frame pos="0 0.1 0" euler="0 0 30"><joint name="twist" class="main" pos="0 0 0.02"/></frame>
          <site name="tool" pos="0 0 0.15"/><site name="other" quat="0.5 0.5 -0.5 0.5"/>
        </body></body></frame></frame></body></body></body>
  <body name="box" pos="1 0 0"><freejoint/>{G}</body></worldbody></mujoco>"""
# Radians, Euler angles about fixed and moving axes, sections behind those that they are for.
RADIANS = f"""<mujoco><worldbody><body name="a" euler="0.3 -0.4 0.5" pos="0 0 1">{G}
  <joint name="j1" range="-1 2" axis="0.3 0.2 1"/><body name="b" pos="0.3 0 0" axisangle="1 2 3 0.7">{G}
  <joint name="j2" ref="-0.4" axis="0 1 0" pos="0 0 0.1"/><body name="c" pos="0 0 0.4" euler="1 2 3">{G}
  <joint type="slide" name="j3" range="0 0.3"/></body></body></body></worldbody>
<compiler angle="radian" eulerseq="ZyX" autolimits="true"/><default><joint range="-2 2"/></default></mujoco>"""
MODELS = {"classes": (CLASSES, ["hand", "tool", "other", "elbow"]), "radians": (RADIANS, ["c"])}


def main():
    import mujoco

    rng = np.random.default_rng(40)
    stored = {"mujoco": mujoco.__version__}
    for name, (text, tips) in MODELS.items():
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        single = [k for k in range(model.njnt) if model.jnt_type[k] >= 2]
        of = stored[name] = {"joints": [], "poses": {tip: [] for tip in tips}}
        of["names"] = [model.joint(k).name for k in single]
        of["limits"] = [model.jnt_range[k].tolist() if model.jnt_limited[k] else None for k in single]
        for _ in range(5):
            q = np.round(rng.uniform(-0.5, 0.5, len(single)), 6)
            for k, value in zip(single, q, strict=True):
                data.qpos[model.jnt_qposadr[k]] = value
            mujoco.mj_forward(model, data)
            of["joints"].append(q.tolist())
            for tip in tips:
                site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, tip) >= 0
                at = data.site(tip) if site else data.body(tip)
                T = np.column_stack([at.xmat.reshape(3, 3), at.xpos])
                of["poses"][tip].append(np.round(T, 12).tolist())
    Path(__file__).with_suffix(".json").write_text(json.dumps(stored) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
