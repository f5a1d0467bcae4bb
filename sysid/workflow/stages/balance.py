"""Stage of the force balance: k and c from the bodies alone, beside those of the fit where there is one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from sysid.display import NOT_DETERMINED, TextTable, shown_unit
from sysid.errors import DataRejectedError, NotConvergedError, SysidError
from sysid.workflow.stage import Blocks, Command, Context, Whole
from sysid.workflow.stages.data import CHECK

if TYPE_CHECKING:
    from sysid.balance.records import AxleLoads, ForceBalance
    from sysid.campaign.vehicle_records import Axle
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
    yield from _of_drives(balance, axles)
    yield from balance.sentences


def _of_drives(balance: ForceBalance, axles: Sequence[Axle]) -> Blocks:
    """Axle loads, tires and roads of drives."""
    if balance.loads:
        numbers = [f"axle {i + 1}" for i in range(len(axles))]
        table = TextTable("Load coefficient, to 25 Hz, and 90 % interval", ("log", "load case", *numbers))
        for loads in balance.loads:
            table.add_row(loads.file, loads.load_case, *coefficient_cells(loads))
        yield table
    if balance.roads:
        table = TextTable("Tires by the drives", ("parameter", "axle", "value", "90 % interval", "unit"))
        for e in balance.tires:
            factor, unit = shown_unit(e.unit)
            value = f"{e.value * factor:.4g}" if e.determined else NOT_DETERMINED
            table.add_row(e.name, axles[e.axle].name, value, f"{e.low * factor:.4g} to {e.high * factor:.4g}", unit)
        yield table
        head = ("log", "km/h", "90 % interval", "class", "G at 0.1/m, cm3", "90 % interval", "waviness")
        table = TextTable("Roads of the drives", head)
        for road in balance.roads:
            speeds, densities = (
                (road.speed_m_s, road.speed_low, road.speed_high),
                (road.density_m3, road.density_low, road.density_high),
            )
            v, v_low, v_high = (f"{3.6 * x:.2f}" for x in speeds)
            g, g_low, g_high = (f"{1e6 * x:.3g}" for x in densities)
            table.add_row(
                road.file, v, f"{v_low} to {v_high}", road.road_class, g, f"{g_low} to {g_high}", f"{road.waviness:.1f}"
            )
        yield table


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
    effort=2.0,
    command=Command(
        help="k, c and axle loads from the bodies alone, whatever the road.",
        show=show_balance,
        fault=_fault,
        next=("run",),
    ),
)
