"""Templates of the sentences of verdicts, for texts and pages.

A template has fields ``{name}`` for names and numbers, and arguments ``<name=value>`` or ``<name=value|option>``, which
:func:`.spell_out` writes as the caller types them. Some templates are parts of sentences, which fill fields of other templates.
"""

from __future__ import annotations

from types import MappingProxyType

from ..text import spell_out

SENTENCES = MappingProxyType(
    {
        "over": "{joint} needs {peak}{doubt} {unit} at t = {time} s, {share} of its limit ({limit} {unit}){because}",
        "because": ". Largest part: {cause}, {share}",
        "doubt": " ± {sigma}",
        "open": "{joint} may exceed its limit{end}, within the noise: {peak} ± {sigma} {unit}, limit {limit} {unit}",
        "end": " at one end of the log",
        "motion": "{joint} exceeds its {kind} limit at t = {time} s by {by} {unit}: {value}, limit {limit}",
        "bearing": "the bearing of {joint}: {kind} {value} {unit} at t = {time} s, limit {limit}",
        "also": "also {others}",
        "other": "{joint} ({kinds})",
        "follower": "{joint}, which follows {leader}, needs {peak} {unit} at t = {time} s, {share} of its limit "
        "({limit} {unit})",
        "open follower": "{joint} may exceed its limit, within the noise: {peak} {unit}, {share} of its limit ({limit} {unit})",
        "held": "{base} is held in the air, and the robot looks legged; {remedy}",
        "hanging": "on a stand: <floating_base=False|fixed-base>, free: "
        "<floating_base=True>, on its feet: torques with <feet='auto'>",
        "hanging, feet": "on its feet: <feet='auto'>, on a stand: "
        "<floating_base=False|fixed-base>, free: <floating_base=True>",
        "hangs, payload": "if a stand holds it: "
        "<floating_base=False|fixed-base>. What a robot that stands on the ground can carry is not computed",
        "hangs": "as it hangs {word}: {excess}",
        "force": "Nothing drives the base, but the motion needs {force} N there{share}",
        "of weight": ", {share} of the robot's weight",
        "open loops": "the file closes {loops}, and torques of {joints} are those of the open tree; closed, in Python: "
        "robot.close({given}, redundant='accept').inverse_dynamics(q, dq, ddq)",
        "opened": "with loops of its file open {word}: {excess}",
        "no contact": "{words}, so contacts are missing from the torques",
        "contact": "{words}. The joints' torques lack what contacts take: constant wrenches are given with "
        "<wrench_on_robot=...>, "
        "others in Python, to robot.inverse_dynamics. If something holds the base in truth, as a stand does, the "
        "torques are right.",
        "unlimited": "no torque limit for {joints}, which cannot be judged; {remedy}",
        "some": "{count} of {all} joints{named}",
        "one": "the joint {joint}",
        "nearest": "all limits kept. Closest: {joint}, {share}{sure} of its torque limit at t = {time} s{because}",
        "nearest bearing": "all limits kept. Closest: the bearing of {joint}, {share} of its limit of {kind} at t = {time} s",
        "near": "{kind} of {joint}: {share} of its limit at t = {time} s",
        "sure": " ± {share} (95 %)",
        "smoothed": "Without smoothing, noise would take {joints} over a limit",
        "no torque": "all limits kept. No joint needs a torque",
        "no motor": "all limits kept. No joint has a motor with a known limit",
        "margin": "Maximum payload on this path: {mass} kg at {frame} (limit of {joint} at t = {time} s).",
        "margin alone": "Maximum payload on this path by joint torques alone: {mass} kg at {frame} (limit of {joint} at "
        "t = {time} s).",
    }
)
"""Templates by name."""


def sentence(name: str, **words: str) -> str:
    """Sentence from the template ``name`` of :data:`SENTENCES`, with ``words`` in its fields.

    >>> sentence("because", cause="payload", share="63 %")
    '. Largest part: payload, 63 %'
    """
    return spell_out(SENTENCES[name]).format(**words)


def spoken_sentences() -> dict[str, str]:
    """All templates by name, with arguments as the caller types them."""
    return {name: spell_out(text) for name, text in SENTENCES.items()}
