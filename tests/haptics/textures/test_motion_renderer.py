"""Rendering of a lattice whose parameters follow the motion."""

import numpy as np

from texclass.haptics.textures.motion_renderer import MotionRenderer


def test_parameters_are_computed_only_when_an_update_starts():
    n_updates = []

    def constant_level(motion):
        n_updates.append(len(motion))
        return np.zeros((len(motion), 0)), np.ones((len(motion), 1))

    renderer = MotionRenderer(constant_level, fs=1000, hop=10, limit=10, seed=0)
    samples = [renderer.process([[80.0, 0.0]], [1.0]) for _ in range(25)]
    assert n_updates == [1, 1, 1]
    whole = MotionRenderer(constant_level, fs=1000, hop=10, limit=10, seed=0)
    np.testing.assert_array_equal(np.concatenate(samples), whole.process([[80.0, 0.0]] * 25, [1.0] * 25))
