"""Which parameters of a plant are its own, and which are those of the slots."""

from dataclasses import replace

from estimator.gap.plant.additions import SLOT_PARAMETERS, Layout
from estimator.gap.plant.interface import Parameter
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
