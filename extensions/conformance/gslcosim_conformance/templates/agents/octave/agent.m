#!/usr/bin/env -S octave-cli --norc --quiet
% NAME: flies half a metre up the wind, again and again. Now make it find the source.

while true
  try
    line = input('', 's');
  catch
    break
  end
  message = jsondecode(line);
  switch message.message
    case 'Briefing'
      height_m = message.search_height_m;
    case 'Observation'
      if message.awaiting_command
        wind = message.readings(strcmp({message.readings.sensor}, 'wind'));
        upwind_rad = wind.values(2);
        xy_m = message.position_world_m(1:2)' + 0.5 * [cos(upwind_rad), sin(upwind_rad)];
        command = struct('tick', message.tick, 'kind', 'waypoint', 'position_world_m', [xy_m, height_m]);
        printf('%s\n', jsonencode(command));
        fflush(stdout);
      end
    case 'Ending'
      break
  end
end
