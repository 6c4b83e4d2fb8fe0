"""SDF files as this library and as Drake read them, side by side: what differs, in words."""

from __future__ import annotations

import numpy as np

TOLERANCE = 1e-9


def drake_plant(source, model=None):
    """(plant, instance) of a path or of XML text; links that no joint holds are welded where the file puts them."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    def read():
        plant = MultibodyPlant(0.0)
        parser = Parser(plant)
        parser.SetAutoRenaming(True)
        if str(source).lstrip().startswith("<"):
            found = parser.AddModelsFromString(str(source), "sdf")
        else:
            found = parser.AddModels(str(source))
        return plant, found

    first, _ = read()
    first.Finalize()
    free = [
        (b.name(), b.model_instance(), first.GetDefaultFloatingBaseBodyPose(b))
        for b in map(first.get_body, first.GetFloatingBaseBodies())
    ]
    plant, found = read()
    for name, instance, X in free:
        plant.WeldFrames(plant.world_frame(), plant.GetBodyByName(name, instance).body_frame(), X)
    plant.Finalize()
    names = {plant.GetModelInstanceName(i).rpartition("::")[2]: i for i in found}
    return plant, names.get(model, found[0]) if model else found[0]


def differences(robot, plant, states=2, seed=0):
    """What is not the same by more than the tolerance: a list of sentences, empty where all is."""
    context = plant.CreateDefaultContext()
    pairs = _joints(robot, plant)
    if isinstance(pairs, str):
        return [pairs]
    rng, found = np.random.default_rng(seed), []
    for _ in range(states):
        q = robot.random_configuration(rng)
        P = np.zeros((plant.num_velocities(), robot.nv))
        theirs = np.zeros(plant.num_positions())
        for body, joint, k in pairs:
            x, v = q[body.places[0]], body.places[1]
            at, vat = joint.position_start(), joint.velocity_start()
            if body.joint.kind == "ball":
                from pydrake.common.eigen_geometry import Quaternion
                from pydrake.math import RollPitchYaw, RotationMatrix

                R = RotationMatrix(Quaternion(x / np.linalg.norm(x)))
                theirs[at : at + 3] = RollPitchYaw(R).vector()
                P[vat : vat + 3, v] = R.matrix()
            else:
                theirs[at + k], P[vat + k, v] = x[0], 1.0
        plant.SetPositions(context, theirs)
        dq = rng.uniform(-1, 1, robot.nv)
        plant.SetVelocities(context, P @ dq)
        M = P.T @ plant.CalcMassMatrix(context) @ P
        found += _gap("M", robot.reference("mass_matrix", q), M)
        g = -P.T @ plant.CalcGravityGeneralizedForces(context)
        scale = max(1e-3, np.abs(M).max(initial=0.0))
        gravity = robot.with_gravity((0, 0, -9.81))
        found += _gap("g", gravity.reference("gravity_forces", q), g, scale)
        if not any(body.joint.kind == "ball" for body, _, _ in pairs):
            c = P.T @ plant.CalcBiasTerm(context)
            found += _gap("c", robot.reference("coriolis_forces", q, dq), c, scale)
        for name in robot.link_names[1:]:
            theirs_name = name.rpartition("::")[2]
            scope = name.rpartition("::")[0]
            bodies = [
                b
                for b in _bodies(plant)
                if b.name() == theirs_name and plant.GetModelInstanceName(b.model_instance()).endswith(scope)
            ]
            if len(bodies) == 1:
                X = plant.EvalBodyPoseInWorld(context, bodies[0]).GetAsMatrix4()
                found += _gap(f"pose of {name}", robot.reference("forward_kinematics", q, frame=name), X, 1.0)
            else:
                found.append(f"{len(bodies)} bodies {name}")
    return found


def _bodies(plant):
    from pydrake.multibody.tree import BodyIndex

    return [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]


def _joints(robot, plant):
    from pydrake.multibody.tree import JointIndex

    theirs = {j.name(): j for j in map(plant.get_joint, plant.GetJointIndices()) if j.num_velocities()}
    pairs, met = [], set()
    for body in robot.model.leaders:
        name, k = body.joint.name, 0
        if name not in theirs and name.endswith((".axis", ".axis2")):
            name, k = name.rpartition(".")[0], int(name.endswith("2"))
        name = name.rpartition("::")[2]
        if name not in theirs:
            return f"joint {name} is not in Drake's plant: {sorted(theirs)}"
        pairs.append((body, theirs[name], k))
        met.add(name)
    assert JointIndex
    left = set(theirs) - met
    return f"joints that only Drake has: {sorted(left)}" if left else pairs


def _gap(what, ours, theirs, scale=None):
    ours, theirs = np.asarray(ours, float), np.asarray(theirs, float)
    size = max(np.abs(theirs).max(initial=0.0) if scale is None else scale, 1e-9)
    gap = np.abs(ours - theirs).max(initial=0.0) / size
    return [] if gap <= TOLERANCE else [f"{what}: {gap:.2g}"]
