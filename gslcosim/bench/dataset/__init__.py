"""Results as a dataset to publish: tables in Parquet, the suite, a datasheet and a description in Croissant."""
