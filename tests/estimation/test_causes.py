"""Which causes are named beside a mistake that the model lacks."""

from sysid.estimation.fit.causes import Cause, beside_mistakes

CAB = Cause("own_springs", "a cab on springs of its own")
BUSHING = Cause("bushing", "the dampers give way", modelled=True)
MASS = Cause("mass", "a load is 2 % higher")


def test_what_may_imitate_a_part_that_the_model_lacks_is_not_named_beside_it():
    """Beside a cab of 700 kg over the steer axle, its dampers seemed to stand in bushings of 1.5 MN/m."""
    assert beside_mistakes((CAB,), (BUSHING, MASS)) == (MASS,)
    assert beside_mistakes((), (BUSHING, MASS)) == (BUSHING, MASS)
