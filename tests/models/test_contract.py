"""Own models keep scikit-learn's contract, by its own checks."""

from sklearn.utils.estimator_checks import parametrize_with_checks

from ges.study.models.analytical import AnalyticalBaseline
from ges.study.models.networks import LstmRegressor, MlpRegressor, TransformerRegressor

VEHICLE = {"thrust_coefficient_N_s2": 1.5e-5}
QUICK = {"epochs": 20, "batch_rows": 32, "learning_rate": 0.03}


@parametrize_with_checks(
    [
        AnalyticalBaseline(VEHICLE, column=0),
        MlpRegressor(**QUICK),
        LstmRegressor(**QUICK, units=8),
        TransformerRegressor(**QUICK, units=8, heads=2, layers=1),
    ]
)
def test_scikit_learn_contract(estimator, check):
    check(estimator)
