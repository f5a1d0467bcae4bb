"""The sandwich adjustment against closed forms of a linear model."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.estimation.fit.optimum import parameter_sd
from sysid.estimation.residuals.run_unknowns import run_normal
from sysid.estimation.uncertainty.information import BlockInformation, model_error
from sysid.estimation.uncertainty.residual_columns import ResidualColumns
from sysid.estimation.uncertainty.sandwich import adjust, block_scores
from sysid.vehicle_model.engines.protocol import Linearisation


def linear_blocks(blocks: int, samples: int, shared: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Scores (blocks, 2) and information (2, 2) at the truth of a line fit whose errors share an offset per block."""
    random = np.random.default_rng(seed)
    x = np.stack([np.ones(samples), np.linspace(-1.0, 1.0, samples)], axis=1)
    errors = random.standard_normal((blocks, samples)) + shared * random.standard_normal((blocks, 1))
    return errors @ x, blocks * x.T @ x


def test_independent_noise_is_left_almost_alone() -> None:
    scores, information = linear_blocks(4000, 20, 0.0, 1)
    found = adjust(scores, range(4000), information, never_sharper=False)
    assert np.allclose(found.inflation, 1.0, atol=0.1)
    assert np.allclose(found.information, information, rtol=0.1, atol=0.05 * information.max())


def test_errors_shared_within_blocks_inflate_by_their_known_factor() -> None:
    samples, shared = 20, 1.5
    scores, information = linear_blocks(4000, samples, shared, 2)
    found = adjust(scores, range(4000), information)
    # An offset common to the n samples of a block multiplies the variance of the constant by 1 + n shared^2.
    assert found.inflation.max() == pytest.approx(1.0 + samples * shared**2, rel=0.1)
    assert found.inflation.min() == pytest.approx(1.0, abs=0.1)


def test_the_adjusted_curvature_is_the_sandwich() -> None:
    scores, information = linear_blocks(300, 20, 1.0, 3)
    found = adjust(scores, range(300), information, never_sharper=False)
    centred = scores - scores.mean(axis=0)
    spread = centred.T @ centred * 300 / 299
    sandwich = information @ np.linalg.inv(spread) @ information
    assert np.allclose(found.information, sandwich, rtol=1e-6)
    assert np.allclose(found.matrix.T @ information @ found.matrix, sandwich, rtol=1e-6)


def test_repeats_in_one_block_count_as_one() -> None:
    scores, information = linear_blocks(200, 20, 0.0, 4)
    doubled = np.concatenate([scores, scores])
    once = adjust(doubled, range(400), 2 * information, never_sharper=False)
    joined = adjust(doubled, [*range(200), *range(200)], 2 * information, never_sharper=False)
    assert np.allclose(joined.inflation, 2.0 * once.inflation, rtol=0.02)


def _linearised(*arrays: np.ndarray) -> Linearisation:
    return Linearisation(*arrays, np.zeros_like(arrays[0]))


def test_a_run_s_own_unknowns_are_eliminated_like_a_schur_complement() -> None:
    random = np.random.default_rng(5)
    residual = random.standard_normal((50, 1, 2))
    jacobian = random.standard_normal((50, 1, 2, 6))
    prior = np.diag([0.3, 0.0, 1.0])[None]
    lin = _linearised(residual, jacobian, np.zeros((1, 2)), np.zeros((1, 2, 6)))
    scores, information, *_ = block_scores(lin, prior)
    dense = jacobian[:, 0].reshape(-1, 6)
    normal = dense.T @ dense
    normal[3:, 3:] += prior[0]
    inverse = np.linalg.inv(normal)
    assert np.allclose(np.linalg.inv(information[0]), inverse[:3, :3], rtol=1e-8)
    total = dense.T @ residual[:, 0].ravel()
    expected = total[:3] - normal[:3, 3:] @ np.linalg.solve(normal[3:, 3:], total[3:])
    assert np.allclose(scores[0].sum(axis=0), expected, rtol=1e-8)


def test_a_run_that_says_nothing_about_its_own_start_does_no_harm():
    random = np.random.default_rng(7)
    columns, gains, prior = random.normal(size=(50, 2, 3, 3)), random.normal(size=(2, 3, 3)), np.zeros((2, 3, 3))
    columns[:, 1, :, 1] = gains[1, :, 1] = 0.0
    first, second = run_normal(columns, gains, prior)
    assert np.all(np.linalg.eigvalsh(second) > 0.0)
    written_out = np.concatenate([columns[:, 0].reshape(-1, 3), gains[0]])
    np.testing.assert_allclose(first, written_out.T @ written_out, rtol=1e-10)
    jacobian = random.normal(size=(40, 7))
    jacobian[:, 5] = 0.0
    problem = SimpleNamespace(
        compressed=lambda vector: SimpleNamespace(jacobian=jacobian), count=4, forget=lambda: None
    )
    seen = jacobian[:, [0, 1, 2, 3, 4, 6]]
    expected = np.sqrt(np.diag(np.linalg.inv(seen.T @ seen))[:4])
    found = parameter_sd(SimpleNamespace(problem=problem, vector=None))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_further_columns_count_like_those_of_parameters() -> None:
    random = np.random.default_rng(8)
    samples, runs, channels = 9, 2, 3
    residual, jacobian = random.normal(size=(samples, runs, channels)), random.normal(size=(samples, runs, channels, 8))
    gain, by_gain = random.normal(size=(runs, channels)), random.normal(size=(runs, channels, 8))
    prior, used = np.array([np.eye(3), 2.0 * np.eye(3)]), np.ones((runs, channels), bool)
    kinds = [ResidualColumns(jacobian[..., k], by_gain[..., k]) for k in ([2, 3], [4])]
    own = [0, 1, 5, 6, 7]
    apart = block_scores(_linearised(residual, jacobian[..., own], gain, by_gain[..., own]), prior, used, kinds)
    together = block_scores(_linearised(residual, jacobian, gain, by_gain), prior, used)
    np.testing.assert_allclose(apart.scores, together.scores, rtol=1e-12)
    np.testing.assert_allclose(apart.information, together.information, rtol=1e-12)
    np.testing.assert_allclose(apart.parts, together.parts, rtol=1e-12)


def test_an_information_that_is_negative_by_rounding_is_taken_as_none() -> None:
    """A combination that the data do not determine, its eigenvalue -1e-8 of the others': the rest is as without it."""
    rng = np.random.default_rng(4)
    scores = rng.normal(size=(60, 2))
    information = scores.T @ scores
    keys = list(range(60))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    wider = np.zeros((3, 3))
    wider[:2, :2], wider[2, 2] = information, -1e-8 * information[0, 0]
    full = adjust(np.column_stack([scores, np.zeros(60)]) @ turn.T, keys, turn @ wider @ turn.T)
    plain = adjust(scores, keys, information)
    assert np.all(np.isfinite(full.matrix))
    np.testing.assert_allclose((turn.T @ full.information @ turn)[:2, :2], plain.information, rtol=1e-5)


def test_scores_and_information_are_those_of_all_rows_written_out():
    """Every channel's rows, its gain's row among them, in one dense matrix; own unknowns of the run out by Schur."""
    random = np.random.default_rng(6)
    samples, runs, channels, shared, own = 7, 2, 3, 4, 3
    residual, jacobian = random.normal(size=(samples, runs, channels)), random.normal(size=(samples, runs, channels, 7))
    gain, by_gain = random.normal(size=(runs, channels)), random.normal(size=(runs, channels, 7))
    prior = np.array([np.diag(random.uniform(1.0, 3.0, own)) for _ in range(runs)])
    used = np.array([[True, False, True], [True, True, True]])
    whole = _linearised(residual, jacobian, gain, by_gain)
    scores, information, parts, *_ = block_scores(whole, prior, used)
    once = block_scores(whole, prior)
    np.testing.assert_allclose(once.information, information, rtol=1e-9)
    assert once.parts == []
    of_channels = iter(parts)
    for r in range(runs):
        rows = [np.vstack([jacobian[:, r, c], by_gain[r, c]]) for c in range(channels)]
        values = [np.append(residual[:, r, c], gain[r, c]) for c in range(channels)]
        normal = np.vstack(rows).T @ np.vstack(rows)
        left = np.linalg.inv(normal[shared:, shared:] + prior[r]) @ normal[shared:, :shared]
        kept = normal[:shared, :shared] - normal[:shared, shared:] @ left
        # 1e-12 of the trace is added to what is eliminated.
        np.testing.assert_allclose(information[r], kept, rtol=1e-9)
        for c in range(channels):
            pull = rows[c].T @ values[c]
            np.testing.assert_allclose(scores[r, c], pull[:shared] - pull[shared:] @ left, rtol=1e-9, atol=1e-10)
            if used[r, c]:
                free = rows[c][:, :shared] - rows[c][:, shared:] @ left
                np.testing.assert_allclose(next(of_channels), free.T @ free, rtol=1e-9, atol=1e-10)
    assert next(of_channels, None) is None


def test_model_error_is_the_factor_by_which_blocks_scatter_more_than_noise():
    """Regressions whose residuals are alike within short stretches: the variance of J'r is known in closed form."""
    random = np.random.default_rng(11)
    # Few blocks: what the unknowns take up of their scatter is an eighth.
    blocks, rows, count, together, prior = 8, 60, 4, 5, 1e-6 * np.eye(4)
    masses = SimpleNamespace(sd=np.zeros(0), readings=np.zeros(0, bool), scales=np.zeros(0, bool))
    nothing = SimpleNamespace(masses=masses, departures=SimpleNamespace(directions=()))
    factors, noise = [], []
    for _ in range(300):
        # Columns alike in the same stretches: five equal readings tell as much as one.
        jacobian = np.repeat(random.normal(size=(blocks, rows // together, count)), together, axis=1)
        for found, alike in ((factors, True), (noise, False)):
            shape = (blocks, rows // together, 1) if alike else (blocks, rows // together, together)
            residual = np.broadcast_to(random.normal(size=shape), (blocks, rows // together, together))
            residual = residual.reshape(blocks, rows)
            flat = jacobian.reshape(-1, count)
            x = -np.linalg.lstsq(flat, residual.ravel(), rcond=None)[0]
            left = residual + jacobian @ x
            scores, parts = np.einsum("brp,br->bp", jacobian, left), jacobian.swapaxes(1, 2) @ jacobian
            data = BlockInformation(flat.T @ flat, scores, tuple(range(blocks)), parts)
            found.append(model_error(data, prior, np.zeros(count), nothing, np.zeros(0)).factor)
    assert np.mean(factors) == pytest.approx(together, rel=0.04)
    # Noise alone: one, but for what scatters above it.
    assert 1.0 <= np.mean(noise) < 1.15
