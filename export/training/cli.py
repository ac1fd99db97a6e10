"""``python -m export train`` and ``rebuild``: train one network, or make all of them from scratch."""

import ctypes
import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from app.io.terminal import counting_progress, say
from app.paths import TRAINING, nets_dir

CONFIGS = Path(__file__).with_name("configs")
DATASET_CONFIGS = Path(__file__).parents[1] / "dataset" / "configs"
M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD = -1, -2, -3  # mallopt's parameters in malloc.h


def train(config: Annotated[Path, typer.Argument(help="Configuration; those of the bundled networks are in "
                                                 "export/training/configs.", metavar="CONFIG.toml")],
          out: Annotated[Path, typer.Option(help="Folder of the run, which continues from a checkpoint there.",
                                            metavar="DIR")],
          dataset: Annotated[Path | None, typer.Option(help="Replaces the configuration's dataset.",
                                                       metavar="DIR")] = None,
          variant: Annotated[str | None, typer.Option(help="A variant of the configuration, such as an ablation.",
                                                      metavar="NAME")] = None,
          workers: Annotated[int | None, typer.Option(help="Processes that render inputs.", min=1,
                                                      show_default="one per core")] = None) -> None:
    """Train a network. The command may be interrupted at any time; running it again continues."""
    _configure_process()  # before torch is imported
    from app.errors import SettingsError
    from export.dataset import Dataset
    from export.training.config import read_config
    from export.training.examples import open_examples, pairs_up_to_saturation, render_missing
    from export.training.loop import Run, network_and_loss

    chosen = read_config(config, dataset, variant)
    pairs = Dataset(chosen.data.dataset)
    network, loss = network_and_loss(chosen)
    contract = network.contract
    if pairs.config.environment != contract.shades_environment:
        light = "environments" if contract.shades_environment else "lights"
        raise SettingsError("the dataset has the wrong kind of light", chosen.data.dataset,
                            f"expected scenes lit by {light} for {contract.name}; see the key environment of the "
                            "dataset's configuration")
    with counting_progress() as bar:
        examples = open_examples(pairs, contract, loss.uses_previous)
        if examples.missing:
            task = bar.add_task("rendering", total=len(examples.missing))
            for count in render_missing(pairs, contract, examples.previous, workers):
                bar.advance(task, count)
        run = Run(chosen, examples, out, pairs_up_to_saturation(pairs, chosen.data.max_saturation))
        task = bar.add_task("training", total=run.steps, completed=run.progress.step)
        validation = run.train(lambda step, steps, terms: bar.update(
            task, completed=step, description=f"training, loss {terms['loss']:.4f}"))
    print(f"{out}: {run.steps} steps, loss on held-out pairs {validation['loss']:.4f}")


# Datasets, named after their configurations in ``export.dataset``: pairs, and networks that are trained on them.
ALL_DATASETS = {"default": (1500, ("bcnn-8", "bcnn-8-single", "gfa-8")), "surround": (2200, ("surround-16",)),
                "environment": (768, ("ndr-8",))}
QUICK_DATASETS = {"quick": (12, ("quick",))}


def rebuild(work: Annotated[Path, typer.Option(help="Folder of the datasets and of the training runs.",
                                               metavar="DIR")],
            out: Annotated[Path | None, typer.Option(
                help="Folder of the networks and of their model cards.", metavar="DIR",
                show_default="nets/; with --quick, nets in --work")] = None,
            quick: Annotated[bool, typer.Option("--quick", help="Check that everything runs, in minutes: a dozen small "
                                                "pairs, and two epochs of the smallest network.")] = False,
            ) -> None:
    """Make the datasets, train on them and export all networks; running it again continues."""
    out = out or (work / "nets" if quick else nets_dir())
    datasets = QUICK_DATASETS if quick else ALL_DATASETS
    for dataset, (pairs, _) in datasets.items():
        _run("dataset", "make", "--out", work / dataset, "--frames", pairs,
             "--config", DATASET_CONFIGS / f"{dataset}.toml")
    _run("onnx", "write", "--out", out)
    for dataset, (_, networks) in datasets.items():
        for name in networks:
            run = work / "runs" / name
            _run("train", CONFIGS / f"{name}.toml", "--dataset", work / dataset, "--out", run)
            _run("onnx", "write", run / "checkpoint.pt", "--out", out)


def _run(*arguments: object) -> None:
    """Run ``python -m export`` with ``arguments``; a command that fails ends this one."""
    command = [sys.executable, "-m", TRAINING, *map(str, arguments)]
    say(f"$ {shlex.join(['python', *command[1:]])}")
    if status := subprocess.run(command).returncode:
        raise typer.Exit(status)


def _configure_process() -> None:
    """Let waiting threads sleep, and keep freed memory in the process.

    Spinning threads make training many times slower beside any other load. Requesting memory from the system for each
    large tensor took a quarter of the training time of BCNN of width 16.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # glibc only
    if mallopt is not None:
        for key, value in ((M_MMAP_THRESHOLD, 2**25), (M_TRIM_THRESHOLD, 2**31 - 1), (M_TOP_PAD, 2**30)):
            mallopt(key, value)
