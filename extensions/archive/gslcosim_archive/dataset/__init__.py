"""Results as a dataset to publish: tables in Parquet, the suite, a datasheet and a description in Croissant."""

DEFAULT_LICENSE = "CC-BY-4.0"
