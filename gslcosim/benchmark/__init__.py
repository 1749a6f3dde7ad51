"""The benchmark: suites of flights, their rows, what they say, and how sure it is.

`suite` turns a file into trials, `execution` flies them, `store` keeps their rows, `metrics` are figures of one flight,
`statistics` are figures of many rows, `report` shows them. Nothing below this package knows of it.
"""
