from recorded_flights import record as record
from recorded_flights import rows_of as rows_of
