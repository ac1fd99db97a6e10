"""The model card of a trained network, written from its checkpoint."""

from collections.abc import Mapping
from pathlib import Path

from app.evaluation.tables import markdown_table
from app.network.channels import CHANNELS
from app.network.contract import ModelContract
from export.training.checkpoint import Checkpoint

COMPARED = "**Files**, compared on the same random, rendered and extreme inputs (for half files, rounded to half)"
MADE_BY = "`python -m export train` and `python -m export onnx write`; see docs/training.md."


def summary(checkpoint: Checkpoint) -> str:
    """Data, steps and seed in one line, for the contract."""
    facts = checkpoint.facts
    return (f"{facts['trained_on']} pairs of {checkpoint.config.data.dataset.name}, {checkpoint.progress.step} steps, "
            f"seed {checkpoint.config.seed}")


def card(checkpoint: Checkpoint, contract: ModelContract, differences: Mapping[Path, float]) -> str:
    """The card as Markdown.

    Parameters
    ----------
    differences : mapping of Path to float
        Error of onnxruntime against torch in single precision for each file, relative to the largest output.
    """
    config, progress, facts = checkpoint.config, checkpoint.progress, checkpoint.facts
    reads = [f"`{t}` [1, {spec.components}, h, w]: " + ", ".join(f"`{c}`" for c in spec.channels)
             for t, spec in contract.inputs.items()]
    terms = ", ".join(f"{name} {value:.4f}" for name, value in progress.validation.items())
    options = ", ".join(f"{k} = {v!r}" for k, v in config.network.options.items()) or "none"
    missing = config.loss.kind == "gfa" and "perceptual" not in progress.validation
    note = ", without its perceptual term, since `features` was not set" if missing else ""
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
        "loss": f"`{config.loss.kind}` {config.loss.options or ''}".strip() + note,
        "steps, batch, seed": f"{progress.step}, {config.schedule.batch}, {config.seed}",
        "time": f"{progress.seconds / 3600:.2f} h on {facts['machine']}, torch {facts['torch']}, {facts['written']}",
        "loss on held-out pairs": terms,
    }
    files = {f"`{path.name}`": f"{path.stat().st_size / 1e6:.2f} MB, onnxruntime within {difference:.1e} of torch"
             for path, difference in differences.items()}
    about, trained_on, exported = (markdown_table(("", ""), table.items()) for table in (rows, training, files))
    return "\n\n".join([f"# {contract.name}", about, "**Trained on**", trained_on, COMPARED, exported,
                        f"**Made by** {MADE_BY}"]) + "\n"
