"""The model card of a trained network, from what its checkpoint knows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from app.network.channels import CHANNELS
from app.network.contract import ModelContract
from export.training.checkpoint import Checkpoint

COMPARED = "**Files**, compared on the same random, real and extreme inputs (of half files, rounded to half)"
MADE_BY = "`python -m export train` and `python -m export onnx`; docs/training.md has the commands."


def summary(checkpoint: Checkpoint) -> str:
    """Data, steps and seed in a few words, for the contract."""
    facts = checkpoint.facts
    return (f"{facts['trained_on']} pairs of {checkpoint.config.data.dataset.name}, {checkpoint.progress.step} steps, "
            f"seed {checkpoint.config.seed}")


def card(checkpoint: Checkpoint, contract: ModelContract, differences: Mapping[Path, float]) -> str:
    """The card as Markdown.

    Parameters
    ----------
    differences : mapping of Path to float
        The files and how far onnxruntime is from torch in single precision, relative to the largest output.
    """
    config, progress, facts = checkpoint.config, checkpoint.progress, checkpoint.facts
    reads = [f"`{t}` [1, {spec.components}, h, w]: " + ", ".join(f"`{c}`" for c in spec.channels)
             for t, spec in contract.inputs.items()]
    terms = ", ".join(f"{name} {value:.4f}" for name, value in progress.validation.items())
    options = ", ".join(f"{k} = {v!r}" for k, v in config.network.options.items()) or "none"
    left_out = _left_out(config.loss.kind, progress.validation)
    rows = {
        "reads": "; ".join(reads),
        "writes": "; ".join(f"`{c}`: {CHANNELS[c].meaning}" for s in contract.outputs.values() for c in s.channels),
        "scale, padding": f"{contract.scale:g} of the output, multiples of {contract.multiple_of}",
        "exposure": f"`{contract.exposure}`",
        "bounces": contract.bounces,
        "scene extent": f"{contract.scene_extent:g}",
        "weights": f"{facts['weights']:,}",
        "paper": contract.paper,
        "licence": contract.licence,
    }
    if remark := checkpoint.network().remark:
        rows["how"] = remark
    training = {
        "preset, options": f"`{config.network.preset}`, {options}",
        "data": f"{facts['trained_on']} of {facts['pairs']} pairs of `{config.data.dataset.name}`",
        "loss": f"`{config.loss.kind}` {config.loss.options or ''}".strip() + left_out,
        "steps, batch, seed": f"{progress.step}, {config.schedule.batch}, {config.seed}",
        "time": f"{progress.seconds / 3600:.2f} h on {facts['machine']}, torch {facts['torch']}, {facts['written']}",
        "loss on held-out pairs": terms,
    }
    files = {f"`{path.name}`": f"{path.stat().st_size / 1e6:.2f} MB, onnxruntime within {difference:.1e} of torch"
             for path, difference in differences.items()}
    return "\n\n".join([f"# {contract.name}", _table(rows), "**Trained on**", _table(training),
                        COMPARED, _table(files), f"**Made by** {MADE_BY}"]) + "\n"


def _left_out(loss: str, terms: Mapping[str, float]) -> str:
    missing = loss == "gfa" and "perceptual" not in terms
    return ", without its perceptual term: no network for it was at hand" if missing else ""


def _table(rows: Mapping[str, str]) -> str:
    return "\n".join(["| | |", "|---|---|", *(f"| {key} | {value} |" for key, value in rows.items())])
