"""Random MJCF models that use everything at once: nested bodies and frames, classes in classes, all shapes and orientations."""

from __future__ import annotations

import numpy as np

_SHAPES = ("sphere", "capsule", "ellipsoid", "cylinder", "box")


def random_mjcf(seed):
    """The text of a model that MuJoCo accepts."""
    return _Maker(np.random.default_rng(seed)).text()


class _Maker:
    def __init__(self, rng):
        self.rng, self.count, self.classes = rng, 0, []

    def text(self):
        rng = self.rng
        settings = {
            "angle": rng.choice(["degree", "radian"]),
            "eulerseq": "".join(rng.choice(list("xyzXYZ"), 3)),
            "inertiafromgeom": rng.choice(["auto", "auto", "true"]),
            "autolimits": "true",
        }
        if rng.random() < 0.2:
            settings["inertiagrouprange"] = "0 2"
        if rng.random() < 0.2:
            settings["settotalmass"] = "7"
        if rng.random() < 0.2:
            settings |= {"boundmass": "0.5", "boundinertia": "0.01"}
        defaults = self._defaults(0)
        bodies = "".join(self._body(0) for _ in range(int(rng.integers(1, 4))))
        return f"<mujoco>{_element('compiler', settings)}{defaults}<worldbody>{bodies}</worldbody></mujoco>"

    def _numbers(self, n, size=1.0):
        return " ".join(f"{x:.4g}" for x in size * self.rng.uniform(-1, 1, n))

    def _class(self):
        known = ["", *self.classes]
        return str(self.rng.choice(known))

    def _defaults(self, depth):
        rng = self.rng
        name = f"c{len(self.classes)}" if depth else ""
        if name:
            self.classes.append(name)
        inner = ""
        if rng.random() < 0.7:
            inner += _element("joint", self._joint_attributes(0.3))
        if rng.random() < 0.7:
            inner += _element("geom", self._geom_attributes(0.3))
        if rng.random() < 0.3:
            inner += _element("site", self._pose(0.5))
        if depth < 3:
            inner += "".join(self._defaults(depth + 1) for _ in range(int(rng.integers(0, 3))))
        return f"<default{f' class={name!r}' if name else ''}>{inner}</default>"

    def _pose(self, chance):
        rng = self.rng
        found = {"pos": self._numbers(3)} if rng.random() < chance else {}
        if rng.random() < chance:
            way = rng.choice(["quat", "axisangle", "euler", "xyaxes", "zaxis"])
            found[str(way)] = self._numbers({"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}[way])
        return found

    def _joint_attributes(self, chance):
        rng = self.rng
        choices = {
            "pos": lambda: self._numbers(3),
            "axis": lambda: self._numbers(3),
            "type": lambda: str(rng.choice(["hinge", "slide"])),
            "damping": lambda: f"{rng.random():.3g}",
            "armature": lambda: f"{rng.random():.3g}",
            "frictionloss": lambda: f"{rng.random():.3g}",
            "stiffness": lambda: f"{rng.random():.3g}",
            "springref": lambda: self._numbers(1),
            "ref": lambda: self._numbers(1),
            "range": lambda: f"-{rng.uniform(0.1, 1):.3g} {rng.uniform(0.1, 1):.3g}",
            "limited": lambda: str(rng.choice(["auto", "false"])),
        }
        return {name: make() for name, make in choices.items() if rng.random() < chance}

    def _geom_attributes(self, chance):
        rng = self.rng
        found = {"type": str(rng.choice(_SHAPES)), "size": " ".join(f"{x:.3g}" for x in rng.uniform(0.05, 0.3, 3))}
        if rng.random() < chance:
            found["mass"] = f"{rng.uniform(0.1, 2):.3g}"
        if rng.random() < chance:
            found["density"] = f"{rng.uniform(100, 2000):.3g}"
        if rng.random() < chance:
            found["group"] = str(rng.integers(0, 4))
        return found | self._pose(chance)

    def _with_class(self, attributes, chance=0.4):
        name = self._class()
        return {"class": name, **attributes} if name and self.rng.random() < chance else attributes

    def _geom(self):
        attributes = self._geom_attributes(0.3)
        if attributes["type"] != "sphere" and self.rng.random() < 0.3:
            attributes = {k: v for k, v in attributes.items() if k in ("type", "size", "mass", "density", "group")}
            attributes["fromto"] = self._numbers(6)
        return _element("geom", self._with_class(attributes))

    def _joint(self, free):
        rng, self.count = self.rng, self.count + 1
        name = {"name": f"j{self.count}"} if rng.random() < 0.7 else {}
        if free:
            return _element("freejoint", name)
        if rng.random() < 0.15:
            return _element(
                "joint",
                {
                    **name,
                    "type": "ball",
                    "pos": self._numbers(3),
                    "armature": "0.1",
                    "stiffness": "0",
                    "limited": "false",
                    "range": "0 0",
                },
            )
        attributes = self._with_class(self._joint_attributes(0.4))
        return _element("joint", {**name, **attributes, "type": str(rng.choice(["hinge", "slide"]))})

    def _body(self, depth):
        rng = self.rng
        self.count += 1
        head = {"name": f"b{self.count}"} if rng.random() < 0.7 else {}
        head |= self._pose(0.7)
        name = self._class()
        if name and rng.random() < 0.3:
            head["childclass"] = name
        free = depth == 0 and rng.random() < 0.25
        joints = "".join(self._joint(free) for _ in range(1 if free else int(rng.integers(0, 4))))
        joints = joints if joints.count("ball") <= 1 or free else joints.split("/>")[0] + "/>"
        if "ball" in joints:  # nothing may turn after a ball
            joints = next(one for one in (j + "/>" for j in joints.split("/>")) if "ball" in one)
        inside = joints + _element(
            "geom", {"size": "0.1", "type": "sphere", "density": "100", "mass": "0.3", "group": "0"}
        )
        inside += "".join(self._geom() for _ in range(int(rng.integers(0, 3))))
        if rng.random() < 0.4:
            spread = rng.uniform(0.05, 0.1, 3)
            values = {"mass": "1.5", "pos": self._numbers(3), "diaginertia": " ".join(f"{x:.4g}" for x in spread)}
            inside += _element("inertial", values | {k: v for k, v in self._pose(0.6).items() if k != "pos"})
        if rng.random() < 0.5:
            self.count += 1
            inside += _element("site", self._with_class({"name": f"s{self.count}", **self._pose(0.6)}))
        if depth < 3:
            inside += "".join(self._body(depth + 1) for _ in range(int(rng.integers(0, 3))))
        if rng.random() < 0.3:
            geom, body = self._geom(), self._body(3) if depth < 3 else ""
            inside += f"<frame {_attributes(self._pose(0.8))}>{geom}{body}</frame>"
        text = f"<body {_attributes(head)}>{inside}</body>"
        return f"<frame {_attributes(self._pose(0.8))}>{text}</frame>" if rng.random() < 0.2 else text


def _attributes(values):
    return " ".join(f'{name}="{value}"' for name, value in values.items())


def _element(tag, values):
    return f"<{tag} {_attributes(values)}/>"
