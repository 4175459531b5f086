"""People follow their motion in MuJoCo."""
