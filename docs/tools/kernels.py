"""Learn the kernels of the method gaussian_process_learned from data sets of `dmae capture`: `make kernels`."""

import argparse
from pathlib import Path

import torch

from dmae.completion.kernel_fitting import FitConfig, fit_all, read_pairs
from dmae.evaluation.synthetic_gaps import perturb


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="+", type=Path, help="data sets with truth and captured poses")
    parser.add_argument("--out", type=Path, required=True, help="file of the kernels")
    parser.add_argument("--seed", type=int, default=0, help="of gaps and batches")
    options = parser.parse_args()
    torch.set_num_threads(1)
    fit_all(read_pairs(options.data), FitConfig(seed=options.seed), perturb).save(options.out)


if __name__ == "__main__":
    main()
