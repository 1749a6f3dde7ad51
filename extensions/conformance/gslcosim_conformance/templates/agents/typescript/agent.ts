// NAME: flies half a metre up the wind, again and again. Now make it find the source.

import { createInterface } from "node:readline";

/** What is read of a Briefing, an Observation and an Ending; all other fields are ignored. */
interface Message {
  message: "Briefing" | "Observation" | "Ending";
  search_height_m: number;
  tick: number;
  awaiting_command: boolean;
  position_world_m: [number, number, number];
  readings: { sensor: string; values: number[] }[];
}

let heightM = 0;
for await (const line of createInterface({ input: process.stdin })) {
  const message: Message = JSON.parse(line);
  if (message.message === "Ending") break;
  if (message.message === "Briefing") heightM = message.search_height_m;
  if (message.awaiting_command) {
    const [x, y] = message.position_world_m;
    const upwindRad = message.readings.find((reading) => reading.sensor === "wind")?.values[1] ?? 0;
    const goal = [x + 0.5 * Math.cos(upwindRad), y + 0.5 * Math.sin(upwindRad), heightM];
    process.stdout.write(JSON.stringify({ tick: message.tick, kind: "waypoint", position_world_m: goal }) + "\n");
  }
}
process.stdin.destroy(); // An open pipe would keep the program alive after Ending.
