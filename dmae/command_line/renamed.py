"""Names that have changed. The old ones work until 0.3, with a note that names the new ones."""

import re

from dmae.registry import UNTIL

_DETECTOR = {
    "detector.view_offset": "detector.noise.view_offset",
    "detector.bias": "detector.noise.bias",
    "detector.correlation": "detector.times.correlation",
    "detector.least_noise": "detector.noise.minimum",
    "detector.blur": "detector.noise.blur",
    "detector.cut_noise": "detector.noise.truncation",
    "detector.guess_noise": "detector.noise.hidden",
    "detector.guess_score": "detector.scores.hidden",
    "detector.score_knows": "detector.scores.error_correlation",
    "detector.least_score": "detector.scores.minimum",
    "detector.bursts": "detector.times.bursts",
    "detector.together": "detector.misses.limb_correlation",
    "detector.hanging": "detector.misses.neighbour_correlation",
    "detector.person_miss": "detector.misses.person",
    "detector.person_miss_hidden": "detector.misses.hidden_person",
    "detector.swap": "detector.swaps.probability",
    "detector.leg_inversion": "detector.inversions.legs",
    "detector.arm_inversion": "detector.inversions.arms",
    "detector.merge": "detector.merges.probability",
    "detector.merge_rest": "detector.merges.remainder",
    "detector.split": "detector.splits.probability",
    "detector.ghosts": "detector.ghosts.count",
    "detector.ghost_joints": "detector.ghosts.joints",
    "detector.ghost_score": "detector.ghosts.score",
    "detector.drop": "detector.drops.probability",
    "detector.drop_repeats": "detector.drops.repeat",
    "detector.out_of_step": "detector.timing.unsynchronised",
    "detector.rolling": "detector.timing.rolling_shutter",
}
_CAPTURE = {
    "capture.matching": "capture.association.joints",
    "capture.half_ray": "capture.association.ray_distance_m",
    "capture.half_colour": "capture.association.colour_difference",
    "capture.colour_weight": "capture.association.colour_weight",
    "capture.th_a": "capture.association.min_affinity",
    "capture.birth_joints": "capture.tracking.birth_joints",
    "capture.seniority": "capture.tracking.confirmation_s",
    "capture.inertia": "capture.tracking.velocity_gain",
    "capture.coast": "capture.tracking.coasting_s",
    "capture.rejoin": "capture.tracking.reentry_s",
    "capture.strange": "capture.tracking.reentry_colour_difference",
    "capture.least_life": "capture.tracking.min_duration_s",
    "capture.reach": "capture.reassignment.distance_m",
    "capture.th_p_again": "capture.reassignment.th_p",
    "capture.bridge": "capture.reassignment.max_gap_s",
    "capture.noise.unsure": "capture.noise.sigma_unsure_m",
    "capture.noise.sure": "capture.noise.sigma_sure_m",
    "capture.noise.pixels": "capture.noise.min_sigma_px",
    "capture.noise.gate": "capture.noise.gate_sigmas",
    "capture.noise.deepest": "capture.noise.max_error_m",
}
_MODEL = {
    "model.dim": "model.encoder.dim",
    "model.depth": "model.encoder.depth",
    "model.heads": "model.encoder.heads",
    "model.head_dim": "model.encoder.head_dim",
    "model.mlp": "model.encoder.mlp",
    "model.decoder_dim": "model.decoder.dim",
    "model.decoder_depth": "model.decoder.depth",
    "model.signal_codes": "model.codes.signal",
    "model.signal_sigma": "model.codes.signal_sigma",
    "model.time_sigma": "model.codes.time_sigma",
    "model.joint_sigma": "model.codes.joint_sigma",
    "model.no_time_code": "model.codes.no_time",
    "model.no_joint_code": "model.codes.no_joint",
    "model.alike": "model.key_init",
    "model.turn_to_front": "model.align_heading",
    "model.blind": "model.ablate",
    "model.ablate=carried": "model.ablate=held",
    "model.ablate=mended": "model.ablate=bone_length",
    "model.ablate=roughness": "model.ablate=jitter",
    "model.ablate=stretch": "model.ablate=bone_stretch",
}
RENAMED: dict[str, dict[str, str]] = {
    "dmae capture": {
        **_CAPTURE,
        "fill=recall": "fill=gaussian_process",
        "fill=reject_recall": "fill=reject_gaussian_process",
    },
    "dmae evaluate": {
        **_CAPTURE,
        "hide=none": "input=captured_poses",
        "hide=clean": "input=true_poses",
        "hide=noisy": "input=perturbed_poses",
        "hiding": "gaps",
        "methods=recall": "methods=gaussian_process",
        "methods=reject_recall": "methods=reject_gaussian_process",
    },
    "dmae train": {
        **_CAPTURE,
        "also": "extra_data",
        "unseen": "validation_data",
        **{name: f"examples.{name}" for name in ("replay", "views", "workers")},
        "validation": "examples.held_back",
        "hiding": "examples.masking",
        "augment.turn": "examples.augment.rotation",
        "augment.clean": "examples.augment.true_poses",
        "augment": "examples.augment",
        **{
            name: f"learning.{name}"
            for name in ("steps", "epoch", "batch", "loss", "lr", "warmup", "weight_decay", "average")
        },
        "shown_weight": "learning.observed_weight",
        "clip": "learning.max_gradient",
        **_MODEL,
    },
    "dmae doctor": {"most_delay": "max_offset"},
    "synth show": {"clip": "data"},
    "synth verify": {"path": "data"},
    "synth generate": _DETECTOR,
    "synth fit-detector": _DETECTOR,
    "synth compare": {
        "miss": "limits.miss",
        "together": "limits.joint_miss",
        "distance": "limits.distance",
        "confidence": "limits.confidence",
        "views": "limits.views",
    },
}
"""By command: old to new. `option: option` also renames all options under it; `option=choice: option=choice` renames
one choice, a preset's name, or an entry of a list."""


def renamed(command: str, overrides: list[str]) -> tuple[list[str], list[str]]:
    """Put new names in the place of old ones.

    Args:
        command: Program and sub-command, as "dmae capture".
        overrides: As users type them, `key=value`.

    Returns:
        The overrides, and a note for each name that was replaced.
    """
    table, notes, found = RENAMED.get(command, {}), [], []
    for override in overrides:
        for old, new in table.items():
            replaced = _choice(override, old, new) if "=" in old else _key(override, old, new)
            if replaced != override:
                notes.append(f"{old} is now called {new}; the old name works until {UNTIL}")
            override = replaced
        found.append(override)
    return found, notes


def _key(override: str, old: str, new: str) -> str:
    key, equals, value = override.partition("=")
    plain = key.lstrip("+~")
    # If an option became a group with the same name, the options below it are new ones.
    below = plain.startswith(f"{old}.") and not new.startswith(f"{old}.")
    if plain != old and not below:
        return override
    return f"{key[: len(key) - len(plain)]}{new}{plain[len(old) :]}{equals}{value}"


def _choice(override: str, old: str, new: str) -> str:
    key, _, value = override.partition("=")
    (old_key, _, old_value), (new_key, _, new_value) = old.partition("="), new.partition("=")
    if key.lstrip("+~") != old_key:
        return override
    # Also replace it in lists, and among the values of a sweep.
    replaced = re.sub(rf"(?<![\w.:/-]){re.escape(old_value)}(?![\w.:/-])", new_value, value)
    return override if replaced == value else f"{key.replace(old_key, new_key)}={replaced}"
