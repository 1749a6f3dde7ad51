function beetle = beetle_new(briefing, height_m)
  % Return a dung beetle that has been told its task and has seen nothing yet.
  margin_m = 1.0;
  if ~strncmp(briefing.contract_version, '1.', 2)
    error('beetle:contract', 'expected contract version 1, was %s', briefing.contract_version);
  end
  beetle.nose = sensor_where(briefing.sensors, 'unit', 'ohm');
  beetle.vane = sensor_where(briefing.sensors, 'model', 'anemometer');
  beetle.min_m = briefing.bounds.min_m(1:2)' + margin_m;
  beetle.max_m = briefing.bounds.max_m(1:2)' - margin_m;
  beetle.height_m = height_m;
  beetle.random_state = uint64(briefing.seed);
  beetle.last_ohm = []; % none yet
  beetle.side = 0; % 0 seeking, +1 zigzagging left of upwind, -1 right of it
end

function name = sensor_where(sensors, field, value)
  % Return the name of the first sensor that has this value in this field.
  found = find(strcmp({sensors.(field)}, value), 1);
  if isempty(found)
    error('beetle:sensors', 'expected a sensor with %s %s, found none', field, value);
  end
  name = sensors(found).name;
end
