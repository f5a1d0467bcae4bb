"""JAX computes on the processor, where the native engine is, also on a machine whose JAX would take a graphics card."""

from __future__ import annotations

import os
import subprocess
import sys

import jax
import pytest

from sysid.errors import SysidError
from sysid.runtime import configure, platform_of_process
from sysid.vehicle_model import engine
from sysid.vehicle_model.engines.native import NATIVE
from sysid.vehicle_model.engines.reference import REFERENCE


@pytest.fixture
def with_card(monkeypatch: pytest.MonkeyPatch):
    """A machine whose JAX takes a graphics card if nobody says otherwise; the settings of JAX as they were after it."""
    before = {name: getattr(jax.config, name) for name in ("jax_platforms", "jax_default_device")}
    for name in before:
        jax.config.update(name, None)
    monkeypatch.delenv("JAX_PLATFORM_NAME", raising=False)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    monkeypatch.setattr("sysid.runtime._Process.ours", False)
    engine._say_once.cache_clear()
    yield monkeypatch
    for name, value in before.items():
        jax.config.update(name, value)
    engine._say_once.cache_clear()


def test_a_notebook_computes_on_the_processor(with_card) -> None:
    with_card.setenv("SYSID_ENGINE", "auto")
    with_card.setattr(engine, "_problem", lambda coordinates: None)  # also on a machine without a compiler
    assert platform_of_process() == "gpu"
    configure()
    assert platform_of_process() == "cpu"
    assert jax.numpy.zeros(1).devices() == {jax.devices("cpu")[0]}
    assert engine.engine_of_process() is NATIVE


def test_a_process_of_our_own_does_not_open_the_card(with_card) -> None:
    with_card.setattr("sysid.runtime._Process.ours", True)
    configure()
    assert jax.config.jax_platforms == "cpu"
    assert jax.config.jax_default_device is None


@pytest.mark.parametrize(("name", "value"), [("jax_platforms", "cuda"), ("jax_default_device", "gpu")])
@pytest.mark.parametrize("ours", [False, True])
def test_what_the_user_chose_stays(with_card, name: str, value: str, ours: bool) -> None:
    with_card.setattr("sysid.runtime._Process.ours", ours)
    jax.config.update(name, value)
    configure()
    assert getattr(jax.config, name) == value
    assert platform_of_process() == "gpu"


@pytest.mark.parametrize("ours", [False, True])
def test_so_does_what_the_user_chose_by_the_older_variable(with_card, ours: bool) -> None:
    with_card.setattr("sysid.runtime._Process.ours", ours)
    with_card.setenv("JAX_PLATFORM_NAME", "gpu")
    configure()
    assert jax.config.jax_platforms is None
    assert platform_of_process() == "gpu"


def test_the_reference_engine_computes_on_a_card_and_one_sentence_says_how_to_leave_it(with_card, caplog) -> None:
    with_card.setenv("SYSID_ENGINE", "auto")
    assert engine.engine_of_process() is engine.engine_of_process() is REFERENCE
    (said,) = caplog.messages
    assert "JAX computes on gpu here" in said
    assert "JAX_PLATFORMS" in said
    assert "compiler" not in said
    with_card.setenv("SYSID_ENGINE", "native")
    with pytest.raises(SysidError, match="JAX computes on gpu"):
        engine.engine_of_process()


_PLATFORMS = """
from sysid.runtime import configure, own_process
own_process()
configure()
import jax
print(jax.config.jax_platforms, *{d.platform for d in jax.devices()})
"""
_SETTINGS = """
import sys
from sysid.runtime import cache_folder, configure, own_process
own_process()
configure()
assert "jax" not in sys.modules
import jax
assert jax.config.jax_compilation_cache_dir == str(cache_folder())
print(jax.numpy.zeros(1).dtype, jax.config.jax_persistent_cache_min_compile_time_secs)
"""


@pytest.mark.parametrize(("chosen", "said"), [(None, "cpu cpu"), ("cpu", "cpu cpu")])
def test_a_new_process_has_the_processor_alone(chosen: str | None, said: str) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "JAX_PLATFORMS"}
    environment |= {} if chosen is None else {"JAX_PLATFORMS": chosen}
    process = subprocess.run(
        [sys.executable, "-c", _PLATFORMS], env=environment, check=True, capture_output=True, text=True
    )
    assert process.stdout.strip() == said


def test_jax_finds_its_settings_where_it_is_loaded_after_them() -> None:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    process = subprocess.run(
        [sys.executable, "-c", _SETTINGS], env=environment, check=True, capture_output=True, text=True
    )
    assert process.stdout.split() == ["float64", "0.1"]
