from .csv_file import read_csv as read_csv, write_csv as write_csv
from .divided_rows import OVERVIEW_TOPIC as OVERVIEW_TOPIC
from .division import Division as Division, division_of as division_of
from .mcap_end import (
    EndCopies as EndCopies,
    checksum_before as checksum_before,
    copies_at_end as copies_at_end,
)
from .mcap_reader import (
    columns_of as columns_of,
    foreign as foreign,
    is_of_rig as is_of_rig,
    mapped as mapped,
    read_mcap as read_mcap,
)
from .mcap_writer import (
    METADATA_NAME as METADATA_NAME,
    McapWriter as McapWriter,
    channel_problems as channel_problems,
    write_mcap as write_mcap,
)
from .mf4_file import write_mf4 as write_mf4
from .parquet_file import read_parquet as read_parquet, write_parquet as write_parquet
from .sample_collector import (
    DAMAGE as DAMAGE,
    ForeignSchemaError as ForeignSchemaError,
    SampleCollector as SampleCollector,
)
from .sample_layout import RECORD_PREFIX as RECORD_PREFIX
