"""Features of simulated everyday surfaces, with which `texclass describe` compares recordings.

`python benchmarks/reference_surfaces.py` (a minute) writes texclass/haptics/reference_surfaces.csv: one row
per surface with the median of its recordings. No dataset card and no study uses surfaces of this seed.
"""

from study import command_line

from texclass.haptics.descriptions import reference_features
from texclass.haptics.scales import REFERENCES_FILE
from texclass.loaders.simulated import open_simulated
from texclass.simulate import Recipe

RECIPE = Recipe(n_surfaces=100, n_recordings=4, n_operators=4, duration_s=6.0, fs=10_000, seed=504)


def main() -> None:
    args = command_line(__doc__, jobs=1)
    features = reference_features(open_simulated(RECIPE, name="reference surfaces"), n_jobs=args.jobs)
    features.to_csv(REFERENCES_FILE, float_format="%.4g", lineterminator="\n")


if __name__ == "__main__":
    main()
