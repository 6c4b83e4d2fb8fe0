"""Sentences of the verdict on a motion, with places for names and numbers: the command prints them, and so does a page."""

from __future__ import annotations

from types import MappingProxyType

SENTENCES = MappingProxyType(
    {
        "over": "{joint} at t = {time} s takes {peak}{doubt} {unit}, limit {limit} ({share}){because}",
        "because": ", mostly {cause} ({share})",
        "doubt": " ± {sigma}",
        "open": "noise leaves open whether {joint} is over its limit{end}: {peak} ± {sigma} {unit}, limit {limit}",
        "end": " at an end of the log",
        "motion": "{joint} at t = {time} s passes its {kind} limit by {by} {unit}: {value}, limit {limit}",
        "also": "also {others}",
        "other": "{joint} ({kinds})",
        "follower": "{joint}, which follows {leader}, at t = {time} s bears {peak} {unit}, limit {limit} ({share})",
        "open follower": "noise leaves open whether {joint} is over its limit: {peak} {unit}, limit {limit} ({share})",
        "force": "Nothing drives the base, but the motion needs {force} N there{share}",
        "of weight": ", {share} of the robot's weight",
        "no contact": "{words}, so contacts are missing from the torques",
        "contact": "{words}. The joints' torques lack what contacts take: constant wrenches are given with --wrench-on-robot "
        "FRAME:…, others in Python, to robot.inverse_dynamics. If something holds the base in truth, as a stand does, the "
        "torques are right.",
        "unlimited": "no torque limit for {joints}, which cannot be judged; {remedy}",
        "some": "{count} of {all} joints{named}",
        "one": "the joint {joint}",
        "nearest": "nearest to its limit is {joint}, {share}{sure} at t = {time} s{because}",
        "sure": " ± {share} (95 %)",
        "smoothed": "noise is smoothed away, which as logged would take {joints} over a limit",
        "no torque": "no limit is passed, and no joint has a torque to give",
        "no motor": "no limit is passed, and no motor has a torque to give",
        "margin": "By the joints' torque limits, a payload there may have up to {mass} kg: {joint} reaches its limit at "
        "t = {time} s.",
    }
)
"""Forms for :meth:`str.format`, by name."""


def sentence(name: str, **words: str) -> str:
    """A sentence of :data:`SENTENCES` with its names and numbers.

    >>> sentence("because", cause="payload", share="63 %")
    ', mostly payload (63 %)'
    """
    return SENTENCES[name].format(**words)
