"""Damage of every kind, on every joint of a leg, for the tests that go through them all."""

WALKING = (
    "healthy",
    "tibia_rm",
    "tibia_rm:limp",
    "tibia_rm:locked",
    "femur_rf",
    "femur_lf:limp",
    "femur_lf:locked",
    "coxa_lm",
    "coxa_lr:limp",
    "coxa_lr:locked",
    "leg_rm",
    "leg_rm:limp",
    "leg_rf+leg_lr",
    "leg_rf+leg_rm",
    "tibia_rf:limp+leg_lm",
    "coxa_rm:locked+femur_rm:locked+tibia_rm:locked",
)
