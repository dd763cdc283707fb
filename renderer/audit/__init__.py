"""The audit by light paths: a second, independent estimator of light that a camera's paths hardly ever find."""
