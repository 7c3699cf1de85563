from .columns import load_columns as load_columns
from .discovered import term_lines as term_lines
from .model import (
    PARAMETERS as PARAMETERS,
    ModelFile as ModelFile,
    ParameterReader as ParameterReader,
    load_model as load_model,
    named_model as named_model,
    override as override,
    physical as physical,
    read_model as read_model,
)
from .model_writing import dump_model as dump_model
from .plant_file import PlantModel as PlantModel
from .plant_loading import load_plant as load_plant
