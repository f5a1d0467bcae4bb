"""Names of columns and paths in four languages, against what their writers meant."""

from __future__ import annotations

import pytest

from sysid.first_look.column_words import column_says, columns_say
from sysid.first_look.file_words import path_says, paths_say
from sysid.first_look.load_cases import load_cases_of

Q, A, B = "suspension_deflection", "axle_acceleration", "body_acceleration"


@pytest.mark.parametrize(
    ("name", "kind", "unit", "number", "place", "side"),
    [
        ("lvdt1_mm", Q, "mm", 1, None, None),
        ("frame_axle_mm", Q, "mm", None, None, None),
        ("axle1_accel_g", A, "g", 1, None, None),
        ("axle0Accel", A, None, 0, None, None),
        ("frame3_accel_g", B, "g", 3, None, None),
        ("Achsbeschleunigung_VA_links [m/s²]", A, "m/s^2", None, "front", "left"),
        ("Federweg HA rechts [mm]", Q, "mm", None, "rear", "right"),
        ("Rahmen über Achse 2 Beschl. (g)", B, "g", 2, None, None),
        ("Höhe Achse 1 [mm]", Q, "mm", 1, None, None),
        ("débattement_2 [mm]", Q, "mm", 2, None, None),
        ("Caisse 1 accélération m/s2", B, "m/s^2", 1, None, None),
        ("acc_essieu_3_gauche", A, None, 3, None, "left"),
        ("trailer2_axle_acc_g", A, "g", 2, "trailer", None),
        ("ch01", None, None, None, None, None),
        ("Kanal 5", None, None, None, None, None),
        ("AI3", None, None, None, None, None),
        # The place of a frame sensor is an axle, and a trailer has a rear too.
        ("accel_châssis_remorque_arrière", B, None, None, "trailer", None),
        ("FR Unsprung acceleration", A, None, None, "front", "right"),
        ("WegHAre", Q, None, None, "rear", "right"),
        ("Beschl. Rahmen hi. re. [g]", B, "g", None, "rear", "right"),
        ("2. Achse Federweg", Q, None, 2, None, None),
        # Two axles are none of them.
        ("Federweg 2./3. Achse", Q, None, None, None, None),
        ("Accel axle 1+2 [g]", A, "g", None, None, None),
        ("Carrera 2º eje 1", Q, None, 2, None, None),
        ("Ay Frame [g]", None, "g", None, None, None),
        ("acc. longi. châssis", None, None, None, None, None),
        ("Aceleración eje trasero izq (m/s²)", A, "m/s^2", None, "rear", "left"),
        ("Recorrido de suspensión eje 3 dcha mm", Q, "mm", 3, None, "right"),
        ("Balgdruck VA li [bar]", "air_pressure", "bar", None, "front", "left"),
        ("pression coussin d'air essieu 2 (bar)", "air_pressure", "bar", 2, None, None),
        ("Nickrate [deg/s]", "pitch_rate", "deg/s", None, None, None),
        ("GPS speed [km/h]", "speed", "km/h", None, None, None),
        # The same accents as one sign or as two.
        ("de\u0301battement_2 [mm]", Q, "mm", 2, None, None),
    ],
)
def test_a_column_says(name, kind, unit, number, place, side) -> None:
    said = column_says(name)
    assert (said.kind, said.unit, said.axle.number, said.axle.place, said.side) == (kind, unit, number, place, side)


@pytest.mark.parametrize(
    "name", ["GPS_lat", "Temperatur Öl", "brake pressure", "accX_axle1", "Lenkradwinkel", "tension batterie", "Zähler"]
)
def test_a_column_that_no_campaign_uses(name: str) -> None:
    assert column_says(name).unused
    assert column_says(name).kind is None


def test_a_phrase_whose_end_is_cut_off_is_no_other_word() -> None:
    """An air spring ("muelle neumático"), not a tire ("neumático")."""
    for name in ("presión muelle neumático kPa", "presión_muelle_neumáti_kPa"):
        assert (column_says(name).kind, column_says(name).unused) == ("air_pressure", None)
    assert column_says("presión neumático kPa").unused


def test_letters_of_two_meanings_mean_what_the_columns_beside_them_do() -> None:
    lone = columns_say(["acc_1_l", "acc_1_r", "acc_2_r"])
    assert [said.side for said in lone.values()] == ["left", "right", None]
    corners = columns_say(["FL acc", "FR acc", "RL acc"])
    assert (corners["FR acc"].axle.place, corners["FR acc"].side) == ("front", "right")
    frames = columns_say(["AX1_Z", "FR1_Z"])
    assert (frames["FR1_Z"].kind, frames["FR1_Z"].axle.place) == (B, None)
    sides = columns_say(["acc_essieu_2_g", "acc_essieu_2_d"])
    assert [(said.side, said.unit) for said in sides.values()] == [("left", None), ("right", None)]
    assert column_says("acc_essieu_2_g").unit == "g"
    # The driver may sit on either side; beside a left word French "dr" is right.
    cut = columns_say(["acc_unsprung_mass_1_dr_g", "acc_unsprung_mass_1_pa_g"])
    assert [said.side for said in cut.values()] == [None, None]
    assert columns_say(["acc_essieu_2_gche", "acc_essieu_2_dr"])["acc_essieu_2_dr"].side == "right"
    assert columns_say(["Beschl der Achse 1 g"])["Beschl der Achse 1 g"].side is None
    # French "d'" is of, beside a left word too.
    of_axles = columns_say(["avant bout d'essieu acc z", "avant bout d’essieu acc gauche", "avant bout_d_essieu acc"])
    assert [said.side for said in of_axles.values()] == [None, "left", None]
    assert {said.kind for said in of_axles.values()} == {"axle_acceleration"}
    assert column_says("course d'amortisseur essieu 2").side is None
    # The first driven axle, or axle 1.
    assert path_says("vide/marche pont 1 2").axle == path_says("vide/marche 2").axle
    assert path_says("vide/marche essieu 1 2").axle.number == 1
    assert (column_says("acc pont 1 g").kind, column_says("acc pont 1 g").doubts) == ("axle_acceleration", ("pont",))
    # Nothing beside it: nothing said, and marked.
    alone = column_says("FR1_Z")
    assert (alone.kind, alone.axle.place, alone.doubts) == (None, None, ("fr",))


@pytest.mark.parametrize(
    ("path", "kind", "speed", "load", "number", "place"),
    [
        ("bump_runs/case1_unloaded_16kmh_run2.csv", "bump_run", 16.0, "empty", None, None),
        ("plank_drops/axle3_drop2.csv", "plank_drop", None, None, 3, None),
        ("leer/Fahrt_24_km_h_3.mf4", "bump_run", 24.0, "empty", None, None),
        ("beladen/v15_2.csv", "bump_run", 15.0, "laden", None, None),
        ("chute_essieu2_1.csv", "plank_drop", None, None, 2, None),
        ("10mph_half_loaded_a.csv", "bump_run", 16.1, "half", None, None),
        ("Abwurf VA 2.csv", "plank_drop", None, None, None, "front"),
        ("vide/passage_8,5kmh_rep2.csv", "bump_run", 8.5, "empty", None, None),
        ("5mps/bump_03.csv", "bump_run", 18.0, None, None, None),
        ("rec_0001.csv", None, None, None, None, None),
        # The name of the file counts before that of its folder.
        ("loaded/empty_9kmh.csv", "bump_run", 9.0, "empty", None, None),
        # A word of one meaning counts before one that may be laden or any load.
        ("vide/essai_charge_3.csv", None, None, "empty", None, None),
        ("sans charge/dos d'âne 15 km-h.csv", "bump_run", 15.0, "empty", None, None),
        ("demi-charge/ralentisseur.csv", "bump_run", None, "half", None, None),
        ("unbeladen/Planke Achse 2 links.csv", "plank_drop", None, "empty", 2, None),
        ("vacío/caída eje trasero 3.csv", "plank_drop", None, "empty", None, "rear"),
        ("cargado_badén_25kmh.csv", "bump_run", 25.0, "laden", None, None),
        ("Leerfahrt2_HA2.csv", None, None, "empty", 2, "rear"),
        ("trailer_axle2_drop1.csv", "plank_drop", None, None, 2, "trailer"),
        ("kerb weight/kerb_1.csv", "plank_drop", None, "empty", None, None),
    ],
)
def test_a_path_says(path, kind, speed, load, number, place) -> None:
    said = path_says(path)
    of_load = None if said.load is None else said.load.kind
    assert (said.kind, said.speed_km_h, of_load) == (kind, speed, load)
    assert (said.axle.number, said.axle.place) == (number, place)


def _cases(*paths: str) -> tuple[dict[str, tuple[str | None, bool]], list[str | None]]:
    """Kind of every load case and whether it is in doubt, and the case of every path."""
    found = load_cases_of(paths_say(paths))
    names = {name: (case.kind, bool(case.doubt)) for name, case in found.names.items()}
    return names, [found.of_file[path].name for path in paths]


def test_load_cases_in_german_and_in_french() -> None:
    # The laden one stands first in the alphabet, the empty one in the list.
    cases, of_paths = _cases("beladen/Fall_A1.csv", "leer/Fall_A1.csv")
    assert (list(cases.items()), of_paths) == ([("leer", ("empty", False)), ("beladen", ("laden", False))],
                                               ["beladen", "leer"])  # fmt: skip
    cases, of_paths = _cases("charge/chute.csv", "vide/chute.csv")
    assert list(cases.items()) == [("vide", ("empty", False)), ("charge", ("laden", True))]
    assert of_paths == ["charge", "vide"]


def test_a_log_that_does_not_say_its_load_case_gets_none() -> None:
    assert _cases("leer/a.csv", "voll/b.csv", "c.csv")[1] == ["leer", "voll", None]
    assert _cases("leer/a.csv", "c.csv")[1] == ["leer", None]
    # Where nothing says any, all are of one: to be confirmed.
    assert _cases("a.csv", "b.csv") == ({"as_tested": (None, True)}, ["as_tested", "as_tested"])


def test_load_cases_that_differ_stay_apart() -> None:
    cases, _ = _cases("50%/a.csv", "75 %/b.csv", "leer/c.csv", "18t/d.csv", "26 t/e.csv")
    assert list(cases) == ["leer", "50%", "75%", "18 t", "26 t"]
    assert cases["26 t"] == (None, True)
    # Words for one thing are one load case, and its table says so.
    assert _cases("leer/a.csv", "unbeladen/b.csv")[0] == {"leer": ("empty", True)}


def test_an_unknown_word_in_place_of_a_load_is_a_load_case_to_be_confirmed() -> None:
    cases, of_paths = _cases("tare/drop_1.csv", "heavy/drop_1.csv", "laden/drop_1.csv", "docs/notes_3.csv")
    assert of_paths == ["tare", "heavy", "laden", None]
    assert cases["heavy"] == (None, True)


@pytest.mark.parametrize(
    ("name", "load", "front"),
    [
        ("marche INT 1 av. charge", "laden", False),
        ("marche av. 1 av. charge", "laden", True),
        ("marche av. 1 s. charge", "empty", True),
        ("Planke VA m. Ladung", "laden", True),
        ("Planke VA o. Ladung", "empty", True),
        ("tren delantero c. carga", "laden", True),
        ("tren delantero s. carga", "empty", True),
    ],
)
def test_with_and_without_are_short_and_no_axles(name: str, load: str, front: bool) -> None:
    """French `av.` is with (avec) before a load and front (avant) elsewhere."""
    said = path_says(f"{name}.csv")
    assert said.load is not None
    assert (said.load.kind, said.load.sure) == (load, True)
    assert (said.axle.place == "front") is front


@pytest.mark.parametrize(
    "path",
    [
        "not loaded/bump 10kmh.csv", "nicht voll beladen/Schwelle 10kmh.csv", "pas chargé/bosse 10kmh.csv",
        "before loading/bump 10kmh.csv", "vor der Beladung/Schwelle 10kmh.csv", "antes de cargar/tope 10kmh.csv",
    ],
)  # fmt: skip
def test_a_load_that_is_denied_is_left_open(path: str) -> None:
    assert path_says(path).load is None


@pytest.mark.parametrize(
    ("path", "load"),
    [
        ("nicht beladen/Schwelle 10kmh.csv", "empty"), ("sin carga/tope 10kmh.csv", "empty"),
        ("no load/bump 10kmh.csv", "empty"), ("non chargé/bosse 10kmh.csv", "empty"), ("TARA_badén_v20.csv", "empty"),
        ("not used/loaded bump 10kmh.csv", "laden"), ("loaded, not washed/bump 10kmh.csv", "laden"),
    ],
)  # fmt: skip
def test_a_phrase_or_another_word_denies_no_load(path: str, load: str) -> None:
    said = path_says(path).load
    assert said is not None
    assert said.kind == load


@pytest.mark.parametrize(
    ("path", "number"),
    [
        ("FV_A2-3_leer_01.csv", None), ("Fall Achse 2-1.csv", 2), ("Fall A2-3.csv", 2), ("caída_2º eje_1.csv", 2),
        ("drop axles 2+3 no 1.csv", None), ("axle 3 drop 2024-05-06.csv", 3),
    ],
)  # fmt: skip
def test_the_axle_of_a_path_with_several_numbers(path: str, number: int | None) -> None:
    assert path_says(path).axle.number == number
