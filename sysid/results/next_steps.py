"""What would bring a calibration further: the same steps in the report and on the terminal."""

from __future__ import annotations

from sysid.numbers import count, listing
from sysid.results import pass_limits
from sysid.results.contents import Judgement, Results
from sysid.results.headline import passes_beyond
from sysid.results.judgement import in_words, unidentified_values


def next_steps(results: Results, judgement: Judgement) -> tuple[str, ...]:
    """What would help, the next step first, in sentences."""
    steps = []
    if results.fit is None:
        steps.append("Run the stage 'fit': it corrects the drop values with the full vehicle model and the bump runs.")
    elif results.status == "preview":
        steps.append("Run again without --quick before you use these numbers.")
    elif not results.fit.converged:
        steps.append(
            "Do what the other warnings say. Declare the travel of suspensions that may reach their stops, or give a "
            "prior to a parameter that is not determined; then fit again."
        )
    elif results.posterior is None:
        steps.append(
            "Run the stage 'sample': its intervals also hold combinations of parameters that the data cannot separate."
        )
    elif results.status == "not_converged":
        steps.append(
            "Run the stage 'sample' again with --resume and a larger --max-steps: it continues where it stopped."
        )
    if results.quality is not None:
        rejected = [f"{c.column} of {c.file}" for c in results.quality.channels if c.verdict == "rejected"]
        if rejected:
            steps.append(f"Check the sensors of {count(len(rejected), 'rejected channel')}: {listing(rejected, 4)}.")
    if unidentified := unidentified_values(results):
        steps.append(f"Add runs at another speed or load to identify {listing(unidentified)}.")
    advice = " ".join(results.advice.statements[:2]) if results.advice is not None else ""
    if unidentified:
        steps.append(advice or "Run the stage 'advise': it says which further run or sensor would help most.")
    steps += pass_limits.remedies(results, passes_beyond(results))
    if results.fit is not None and results.predictions is None and results.campaign.predictions:
        steps.append("Run the stage 'predict' for the axle loads of the passes in the campaign file.")
    if results.status == "converged" and results.posterior is not None and not judgement.forbids:
        passes = results.predictions is not None and results.predictions.passes
        steps.append(
            "Take k and c from parameters.csv"
            + (" and axle-load histories from predictions/*.csv" if passes else "")
            + "; they are the numbers of this report."
        )
    if advice and not unidentified:
        steps.append(advice)
    if axles := _axles_without_drops(results):
        steps.append(
            f"For {listing(axles)} no drop gives a decrement; repeat the drops towed and with the engine off, or rely "
            "on the fitted values."
        )
    return tuple(map(in_words, steps))


def _axles_without_drops(results: Results) -> list[str]:
    if results.drops is None:
        return []
    pooled = [e for e in results.drops.pooled if e.method == "paper"]
    return [f"axle {e.axle + 1}" for e in pooled if not e.usable]
