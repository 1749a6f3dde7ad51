# One decision of the dung beetle. The input is an observation; $briefing, $memory and $draws are given. The output is
# the command, the new memory, and how many of the random numbers in $draws were used.
# The rules and the exact arithmetic are those of agents/dung_beetle/README.md.

def to_millimetre: (. * 1000.0 + 0.5 | floor) / 1000.0;

def value_of($sensor; $index): first(.readings[] | select(.sensor == $sensor)).values[$index];

# All headings in the order in which they are tried, each with the side it is flown on and the random numbers used.
def headings($side; $upwind_rad; $is_blocked):
  def rule:
    if $side != 0 then
      ($side, -$side | {side: ., rad: ($upwind_rad + . * 1.0471975511965976)}),
      {side: -$side, rad: ($upwind_rad + 3.141592653589793)}
    elif $is_blocked then empty
    else {side: 0, rad: ($upwind_rad + 1.5707963267948966)}
    end;
  (rule | .drawn = 0),
  (range(100) | {side: -$side, rad: (6.283185307179586 * ($draws[.] / 9007199254740992.0)), drawn: (. + 1)});

first($briefing.sensors[] | select(.unit == "ohm")).name as $nose
| first($briefing.sensors[] | select(.model == "anemometer")).name as $vane
| ($briefing.bounds.min_m | map(. + 1.0)) as $min_m
| ($briefing.bounds.max_m | map(. - 1.0)) as $max_m
| .position_world_m as [$x_m, $y_m]
| value_of($nose; 0) as $ohm
| ($memory.last_ohm != null and $ohm < $memory.last_ohm) as $has_more_gas
| (if $has_more_gas | not then -$memory.side elif $memory.side == 0 then 1 else $memory.side end) as $side
# The end of the first leg that keeps away from the walls; without one, leave the margin.
| first(
    (
      headings($side; value_of($vane; 1); .notice != null)
      | .goal_m = [$x_m + 0.8 * (.rad | cos), $y_m + 0.8 * (.rad | sin)]
      | .goal_m |= map(to_millimetre)
      | select($min_m[0] <= .goal_m[0] and .goal_m[0] <= $max_m[0])
      | select($min_m[1] <= .goal_m[1] and .goal_m[1] <= $max_m[1])
    ),
    {
      side: -$side,
      drawn: 100,
      goal_m: ([[$min_m[0], ([$max_m[0], $x_m] | min)], [$min_m[1], ([$max_m[1], $y_m] | min)]] | map(max | to_millimetre))
    }
  ) as $leg
| {tick, kind: "waypoint", position_world_m: ($leg.goal_m + [$briefing.search_height_m])},
  {last_ohm: $ohm, side: $leg.side},
  $leg.drawn
