"""What a recording holds, read back from its file."""

import rerun.blueprint as rrb
from rerun.chunk import RrdReader


def column(path, entity, component):
    """Return all rows of a component: their ticks, times [s] and values, by tick."""
    rows = []
    for chunk in RrdReader(path).store().stream().to_chunks():
        batch = chunk.to_record_batch()
        if str(chunk.entity_path) != entity or component not in batch.schema.names:
            continue
        ticks, values = batch.column("tick").to_pylist(), batch.column(component).to_pylist()
        times_ns = batch.column("sim_time").cast("int64").to_pylist()
        rows += zip(ticks, [ns * 1e-9 for ns in times_ns], values, strict=True)
    return [list(column) for column in zip(*sorted(rows, key=lambda row: row[0]), strict=True)]


def still(path, entity, component):
    """Return what a component shows at all times."""
    for chunk in RrdReader(path).store().stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.is_static and str(chunk.entity_path) == entity and component in batch.schema.names:
            return batch.column(component).to_pylist()[0]
    raise KeyError(f"{entity} has no {component} that stands still")


def views(part):
    """Return all views of a part of a blueprint."""
    return [part] if isinstance(part, rrb.View) else [view for item in part.contents for view in views(item)]


def view_names(blueprint):
    """Return the names of all views of a blueprint."""
    return [view.name for view in views(blueprint.root_container)]
