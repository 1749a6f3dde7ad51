function [beetle, goal_m] = beetle_decide(beetle, seen)
  % Return the beetle after its decision, and the end of its next leg, [x y z] in the world frame.
  %
  % The rules and the exact arithmetic are those of agents/dung_beetle/README.md.
  ohm = value_of(seen, beetle.nose, 1);
  upwind_rad = value_of(seen, beetle.vane, 2);
  has_more_gas = ~isempty(beetle.last_ohm) && ohm < beetle.last_ohm;
  beetle.last_ohm = ohm;
  if beetle.side == 0
    beetle.side = double(has_more_gas);
  elseif ~has_more_gas
    beetle.side = -beetle.side;
  end
  is_blocked = isfield(seen, 'notice') && ~isempty(seen.notice);
  [beetle, xy_m] = next_waypoint(beetle, seen.position_world_m(1:2)', upwind_rad, is_blocked);
  goal_m = [xy_m, beetle.height_m];
end

function [beetle, goal_m] = next_waypoint(beetle, start_m, upwind_rad, is_blocked)
  % Return the end of the first leg that keeps away from the walls; without one, leave the margin.
  full_turn_rad = 6.283185307179586;
  n_random_headings = 100;
  [headings_rad, sides] = headings_of_rule(beetle.side, upwind_rad, is_blocked);
  for i = 1:numel(headings_rad)
    beetle.side = sides(i);
    goal_m = end_of_leg(start_m, headings_rad(i));
    if fits(beetle, goal_m)
      return
    end
  end
  for i = 1:n_random_headings
    [beetle.random_state, fraction] = split_mix_64(beetle.random_state);
    goal_m = end_of_leg(start_m, full_turn_rad * fraction);
    if fits(beetle, goal_m)
      return
    end
  end
  goal_m = to_millimetre(max(beetle.min_m, min(beetle.max_m, start_m)));
end

function [headings_rad, sides] = headings_of_rule(side, upwind_rad, is_blocked)
  % Return the headings to try before random ones, and the side that each is flown on.
  right_angle_rad = 1.5707963267948966;
  zigzag_rad = 1.0471975511965976; % 60 degrees
  half_turn_rad = 3.141592653589793;
  if side ~= 0
    sides = [side, -side, -side];
    headings_rad = upwind_rad + [side * zigzag_rad, -side * zigzag_rad, half_turn_rad];
  elseif is_blocked
    sides = [];
    headings_rad = [];
  else
    sides = 0;
    headings_rad = upwind_rad + right_angle_rad;
  end
end

function goal_m = end_of_leg(start_m, heading_rad)
  leg_m = 0.8;
  goal_m = to_millimetre(start_m + leg_m * [cos(heading_rad), sin(heading_rad)]);
end

function answer = fits(beetle, goal_m)
  answer = all(beetle.min_m <= goal_m & goal_m <= beetle.max_m);
end

function length_m = to_millimetre(length_m)
  % Round to whole millimetres, so that the last bit of sin and cos has no effect.
  length_m = floor(length_m * 1000.0 + 0.5) / 1000.0;
end

function value = value_of(seen, sensor, index)
  % Return one number of a sensor's reading.
  reading = seen.readings(strcmp({seen.readings.sensor}, sensor));
  value = reading.values(index);
end
