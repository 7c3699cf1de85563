from .added_terms import (
    FORMS as FORMS,
    MOST_OTHERS as MOST_OTHERS,
    MOST_TERMS as MOST_TERMS,
    MOVING_OIL as MOVING_OIL,
    PLACES as PLACES,
    QUANTITIES as QUANTITIES,
    AddedTerm as AddedTerm,
    added as added,
    fields_of as fields_of,
    is_held as is_held,
    place_units as place_units,
    quantity_unit as quantity_unit,
    terms_of as terms_of,
    unit_per as unit_per,
)
from .blocking import (
    OPEN_CONDUCTANCE as OPEN_CONDUCTANCE,
    leak_conductance as leak_conductance,
    throttled as throttled,
)
from .command_effects import (
    LONGEST_DELAY_TICKS as LONGEST_DELAY_TICKS,
    PATH_SIZE as PATH_SIZE,
    command_path as command_path,
    command_through_play as command_through_play,
    delayed_command as delayed_command,
    drive as drive,
    drive_undelayed as drive_undelayed,
    hold_reference as hold_reference,
    start_clock as start_clock,
)
from .compiled import compile_part as compile_part, inlined as inlined, inner as inner
from .dynamics import (
    ATMOSPHERE as ATMOSPHERE,
    PlantState as PlantState,
    added_inflows as added_inflows,
    aeration_compliance as aeration_compliance,
    aeration_softening as aeration_softening,
    chamber_volumes as chamber_volumes,
    is_real_valve as is_real_valve,
    lapped as lapped,
    leak_flows as leak_flows,
    open_leaks as open_leaks,
    port_flows as port_flows,
    rest_state as rest_state,
    signed_root as signed_root,
    signed_roots as signed_roots,
    spring_force as spring_force,
    total_mass as total_mass,
    valve_conductance as valve_conductance,
    valve_drops as valve_drops,
    valve_flows as valve_flows,
)
from .effects import (
    CATALOGUE as CATALOGUE,
    REMEMBERING as REMEMBERING,
    EffectParameter as EffectParameter,
    Model as Model,
    PlantEffect as PlantEffect,
)
from .faults import (
    FAULT_COLUMNS as FAULT_COLUMNS,
    FAULTS as FAULTS,
    LEAKS as LEAKS,
    NO_FAULT as NO_FAULT,
    FaultInput as FaultInput,
    FaultName as FaultName,
    LeakName as LeakName,
)
from .integrator import (
    LONGEST_STEP as LONGEST_STEP,
    SUBSTEPS as SUBSTEPS,
    TICK as TICK,
    next_step as next_step,
)
from .memory_laws import (
    NO_FRACTION as NO_FRACTION,
    lagged as lagged,
    play as play,
    whole_ticks as whole_ticks,
)
from .model_hash import model_sha256 as model_sha256
from .parameters import (
    BRISTLE as BRISTLE,
    FRICTION_LAWS as FRICTION_LAWS,
    GALLON_PER_MINUTE as GALLON_PER_MINUTE,
    KARNOPP as KARNOPP,
    LITRE_PER_MINUTE as LITRE_PER_MINUTE,
    MOST_KNOTS as MOST_KNOTS,
    MOST_TABLES as MOST_TABLES,
    NOMINAL as NOMINAL,
    PSI as PSI,
    Parameters as Parameters,
    Quantity as Quantity,
    quantities as quantities,
)
from .sensors import (
    DATA_SHEET as DATA_SHEET,
    READING_COUNT as READING_COUNT,
    Reading as Reading,
    SensorParameters as SensorParameters,
    encoder_position as encoder_position,
    follow_flows as follow_flows,
    noisy_readings as noisy_readings,
    pressure_reading as pressure_reading,
    read_sensors as read_sensors,
    sample_sensors as sample_sensors,
)
from .simulation import simulate as simulate
from .step_length import SHORTEST as SHORTEST, resolving_step as resolving_step
from .transducer_effects import (
    TRANSDUCERS_SIZE as TRANSDUCERS_SIZE,
    follow as follow,
    reading_means as reading_means,
    seen_position as seen_position,
    transducers as transducers,
)
