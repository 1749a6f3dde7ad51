#!/bin/sh
# NAME: flies half a metre up the wind, again and again. Now make it find the source.

while IFS= read -r message; do
  case $message in
    *'"message":"Briefing"'*)
      height_m=$(echo "$message" | jq .search_height_m)
      ;;
    *'"awaiting_command":true'*)
      echo "$message" | jq --compact-output --argjson z_m "$height_m" '
        (.readings[] | select(.sensor == "wind")).values[1] as $upwind_rad
        | .position_world_m as [$x_m, $y_m]
        | [$x_m + 0.5 * ($upwind_rad | cos), $y_m + 0.5 * ($upwind_rad | sin), $z_m] as $goal_m
        | {tick, kind: "waypoint", position_world_m: $goal_m}'
      ;;
    *'"message":"Ending"'*)
      break
      ;;
  esac
done
