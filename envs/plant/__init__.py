"""The "real" robot: MuJoCo with hidden effects along the signal chain. `envs.plant.plant` is the way in."""
