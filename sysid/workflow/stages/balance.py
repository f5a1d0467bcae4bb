"""Stage of the force balance: k and c from the bodies alone, beside those of the fit where there is one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from sysid.display import NOT_DETERMINED, TextTable, shown_unit
from sysid.errors import DataRejectedError, NotConvergedError, SysidError
from sysid.workflow.stage import Blocks, Command, Context, Whole
from sysid.workflow.stages.data import CHECK

if TYPE_CHECKING:
    from sysid.balance.records import AxleLoads, ForceBalance
    from sysid.results.contents import Results


def _balance(context: Context) -> ForceBalance:
    from sysid.balance import balance_forces

    context.progress("forces on the bodies", 0.0)
    return balance_forces(context.campaign)


def show_balance(balance: ForceBalance, results: Results) -> Blocks:
    """k and c with 90 % intervals, beside the fit's, and what each log leaves unexplained."""
    from sysid.balance import disagreement

    axles = results.campaign.vehicle.axles
    beside = {} if results.fit is None else {d.name: d for d in disagreement(balance, results.fit)}
    if balance.estimates:
        head = ("parameter", "axle", "value", "90 % interval", "unit")
        table = TextTable("Force balance", head + (("fit", "apart, sd") if beside else ()))
        for e in balance.estimates:
            factor, unit = shown_unit(e.unit)
            interval = f"{e.low * factor:.4g} to {e.high * factor:.4g}"
            row = [e.name, axles[e.axle].name, f"{e.value * factor:.4g}" if e.determined else NOT_DETERMINED]
            row += [interval, unit]
            if beside:
                d = beside.get(e.name)
                row += ["-", "-"] if d is None else [f"{d.fit * factor:.4g}", f"{d.in_sd:+.1f}"]
            table.add_row(*row)
        yield table
        table = TextTable("Logs in the balance", ("log", "load case", "used s", "unexplained"))
        for r in balance.records:
            table.add_row(r.file, r.load_case, f"{r.used_s:.1f}", f"{r.unexplained:.1%}")
        yield table
    if balance.loads:
        numbers = [f"axle {i + 1}" for i in range(len(axles))]
        table = TextTable("Load coefficient, to 25 Hz, and 90 % interval", ("log", "load case", *numbers))
        for loads in balance.loads:
            table.add_row(loads.file, loads.load_case, *coefficient_cells(loads))
        yield table
    yield from balance.sentences


def coefficient_cells(loads: AxleLoads) -> list[str]:
    """Load coefficients of a log, with 90 % intervals."""
    rows = zip(loads.coefficient, loads.low, loads.high, strict=True)
    return [f"{value:.3f} ({low:.3f}-{high:.3f})" for value, low, high in rows]


def _fault(balance: ForceBalance) -> type[SysidError] | None:
    if not balance.estimates:
        return DataRejectedError
    return None if balance.converged else NotConvergedError


BALANCE = Whole(
    name="balance",
    compute=_balance,
    needs=(CHECK,),
    code=("balance",),
    put=lambda results, balance: replace(results, balance=balance),
    in_run="always",
    effort=5.0,
    command=Command(
        help="Stiffness and damping of every axle, and axle loads of road drives, from the balance of forces on the "
        "bodies, whatever the road was.",
        show=show_balance,
        fault=_fault,
        next=("run",),
    ),
)
