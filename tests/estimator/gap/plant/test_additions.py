"""Which parameters of a plant are its own, and which are those of the slots."""

from dataclasses import replace

import numpy as np

from estimator.gap.plant.additions import SLOT_PARAMETERS, Addition, Layout, in_files
from estimator.gap.plant.interface import Parameter
from estimator.gap.search.added_variables import addition_variables, renamed
from estimator.gap.servo.actuator import servo_actuator
from rig.plant import Model, Parameters


def test_a_plant_may_name_a_parameter_of_its_own_as_something_added() -> None:
    servo = servo_actuator(Model())
    assert [each.name for each in servo.own_parameters] == list(Parameters._fields)
    mass = Parameter("added_mass", "kg", 0.0, 10.0)
    layout = Layout((), {}, (), (), [mass.name])
    sled = replace(servo, parameters=(mass, *SLOT_PARAMETERS), layout=layout)
    assert sled.own_parameters == (mass,)
    assert replace(sled, parameters=(mass,), layout=None).own_parameters == (mass,)


def test_a_file_holds_what_is_beyond_a_limit_as_a_table_that_is_the_same() -> None:
    clipped = Addition("spool", "command", "", "beyond", (0.6,), (-2.6e-5,))
    volts = np.linspace(-10.0, 10.0, 401)
    written = in_files(clipped)
    assert written.form == "table"
    assert np.abs(written.shape(volts) - clipped.shape(volts)).max() < 1e-12 * 2.4e-4
    assert in_files(written) == written


def test_a_drag_is_fitted_by_its_own_size_once_a_table_joins_it() -> None:
    plant = servo_actuator(Model())
    layout = plant.layout
    assert layout is not None
    drag = Addition("force balance", "velocity", "", "x |x|", (), (5.0,))
    spring = Addition("force balance", "position", "", "table", (0.1, 0.2, 0.3), (1.0, 2.0, 3.0))
    alone = addition_variables(layout, [drag], [0])
    # The rig's terms begin with tables, so that the drag is the second of them now.
    (size,) = renamed(layout, alone, [drag], [drag, spring])
    values = size.put({**plant.nominal, **layout.values([drag, spring])}, 7.0)
    assert layout.additions(values) == [spring, replace(drag, values=(7.0,))]
