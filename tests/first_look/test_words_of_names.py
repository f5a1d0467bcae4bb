"""Names of columns and paths in three languages, against what their writers meant."""

from __future__ import annotations

import pytest

from sysid.first_look.file_words import path_says
from sysid.first_look.words import column_says, paired_sides

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
    ],
)
def test_a_column_says(name, kind, unit, number, place, side) -> None:
    said = column_says(name)
    assert (said.kind, said.unit, said.number, said.place, said.side) == (kind, unit, number, place, side)


@pytest.mark.parametrize(
    "name", ["speed_kmh", "GPS_lat", "Temperatur Öl", "brake pressure", "accX_axle1", "Lenkradwinkel"]
)
def test_a_column_that_no_campaign_uses(name: str) -> None:
    assert column_says(name).other
    assert column_says(name).kind is None


def test_sides_of_one_letter_count_in_pairs_only() -> None:
    assert paired_sides(["acc_1_l", "acc_1_r", "acc_2_r"]) == {"acc_1_l": "left", "acc_1_r": "right"}


@pytest.mark.parametrize(
    ("path", "kind", "speed", "load", "axle", "place"),
    [
        ("bump_runs/case1_unloaded_16kmh_run2.csv", "bump_run", 16.0, "empty", None, None),
        ("plank_drops/axle3_drop2.csv", "plank_drop", None, None, 3, None),
        ("leer/Fahrt_24_km_h_3.mf4", "bump_run", 24.0, "empty", None, None),
        ("beladen/v15_2.csv", "bump_run", 15.0, "laden", None, None),
        ("chute_essieu2_1.csv", "plank_drop", None, None, 2, None),
        ("10mph_half_loaded_a.csv", "bump_run", 16.1, "partly", None, None),
        ("Abwurf VA 2.csv", "plank_drop", None, None, None, "front"),
        ("vide/passage_8,5kmh_rep2.csv", "bump_run", 8.5, "empty", None, None),
        ("5mps/bump_03.csv", "bump_run", 18.0, None, None, None),
        ("rec_0001.csv", None, None, None, None, None),
        # The name of the file counts before that of its folder.
        ("loaded/empty_9kmh.csv", "bump_run", 9.0, "empty", None, None),
    ],
)
def test_a_path_says(path, kind, speed, load, axle, place) -> None:
    said = path_says(path)
    assert (said.kind, said.speed_km_h, said.load_case, said.axle, said.place) == (kind, speed, load, axle, place)
