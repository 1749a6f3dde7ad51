// The dung beetle in TypeScript: length-prefixed msgpack on standard input and output, on Node 20 or later.
// The rules and the exact arithmetic are those of ../dung_beetle/README.md.

import { decode, encode } from "@msgpack/msgpack";

const LEG_M = 0.8;
const WALL_MARGIN_M = 1.0;
const RIGHT_ANGLE_RAD = 1.5707963267948966;
const ZIGZAG_RAD = 1.0471975511965976;
const HALF_TURN_RAD = 3.141592653589793;
const FULL_TURN_RAD = 6.283185307179586;
const N_RANDOM_HEADINGS = 100;

type Vec3 = [number, number, number];

// Of each message the fields that this agent reads; all others are ignored.
interface Briefing {
  message: "Briefing";
  contract_version: string;
  seed: number;
  bounds: { min_m: Vec3; max_m: Vec3 };
  search_height_m: number;
  sensors: { name: string; model: string; unit: string }[];
}

interface Observation {
  message: "Observation";
  tick: number;
  position_world_m: Vec3;
  awaiting_command: boolean;
  readings: { sensor: string; values: number[] }[];
  notice: string | null;
}

interface Ending {
  message: "Ending";
}

interface Command {
  tick: number;
  kind: "waypoint";
  position_world_m: Vec3;
}

/** Seeks gas across the wind, then zigzags up the wind; all it remembers is one reading and its side. */
class DungBeetle {
  private readonly nose: string;
  private readonly vane: string;
  private randomState: bigint;
  private lastOhm: number | undefined;
  private side = 0; // 0 seeking, +1 zigzagging left of upwind, -1 right of it

  constructor(private readonly briefing: Briefing) {
    const version = briefing.contract_version;
    if (!version.startsWith("1.")) throw new Error(`expected contract version 1, was ${version}`);
    const nose = briefing.sensors.find((sensor) => sensor.unit === "ohm");
    const vane = briefing.sensors.find((sensor) => sensor.model === "anemometer");
    if (!nose || !vane) throw new Error("expected a gas sensor in ohm and an anemometer");
    this.nose = nose.name;
    this.vane = vane.name;
    this.randomState = BigInt(briefing.seed);
  }

  /** Returns the next leg. */
  decide(observation: Observation): Command {
    const ohm = reading(observation, this.nose, 0);
    const upwindRad = reading(observation, this.vane, 1);
    const hasMoreGas = this.lastOhm !== undefined && ohm < this.lastOhm;
    this.lastOhm = ohm;
    if (this.side === 0) this.side = hasMoreGas ? 1 : 0;
    else if (!hasMoreGas) this.side = -this.side;
    const [x, y] = this.nextWaypoint(observation, upwindRad);
    return { tick: observation.tick, kind: "waypoint", position_world_m: [x, y, this.briefing.search_height_m] };
  }

  /** Returns the end of the first possible leg that keeps away from the walls; without one, leaves the margin. */
  private nextWaypoint(observation: Observation, upwindRad: number): [number, number] {
    const [x0, y0] = observation.position_world_m;
    const [minX, minY] = this.briefing.bounds.min_m.map((low) => low + WALL_MARGIN_M) as Vec3;
    const [maxX, maxY] = this.briefing.bounds.max_m.map((high) => high - WALL_MARGIN_M) as Vec3;
    for (const headingRad of this.headingsRad(upwindRad, typeof observation.notice === "string")) {
      const x = toMillimetre(x0 + LEG_M * Math.cos(headingRad));
      const y = toMillimetre(y0 + LEG_M * Math.sin(headingRad));
      if (minX <= x && x <= maxX && minY <= y && y <= maxY) return [x, y];
    }
    return [toMillimetre(clamp(x0, minX, maxX)), toMillimetre(clamp(y0, minY, maxY))];
  }

  /** Yields headings in the order in which they are tried: the rule's own, then what is left at a wall. */
  private *headingsRad(upwindRad: number, isBlocked: boolean): Generator<number> {
    if (this.side === 0) {
      if (!isBlocked) yield upwindRad + RIGHT_ANGLE_RAD;
    } else {
      yield upwindRad + this.side * ZIGZAG_RAD;
      this.side = -this.side;
      yield upwindRad + this.side * ZIGZAG_RAD;
      yield upwindRad + HALF_TURN_RAD;
    }
    for (let i = 0; i < N_RANDOM_HEADINGS; i++) yield FULL_TURN_RAD * this.randomFraction();
  }

  /** Returns the next random number in [0, 1), by SplitMix64. */
  private randomFraction(): number {
    this.randomState = BigInt.asUintN(64, this.randomState + 0x9e3779b97f4a7c15n);
    let z = this.randomState;
    z = BigInt.asUintN(64, (z ^ (z >> 30n)) * 0xbf58476d1ce4e5b9n);
    z = BigInt.asUintN(64, (z ^ (z >> 27n)) * 0x94d049bb133111ebn);
    return Number((z ^ (z >> 31n)) >> 11n) / 2 ** 53;
  }
}

function reading(observation: Observation, sensor: string, index: number): number {
  const value = observation.readings.find((item) => item.sensor === sensor)?.values[index];
  if (value === undefined) throw new Error(`no reading ${index} of ${sensor}`);
  return value;
}

// Rounded to whole millimetres, so that the last bit of sin and cos has no effect.
function toMillimetre(lengthM: number): number {
  return Math.floor(lengthM * 1000 + 0.5) / 1000;
}

function clamp(value: number, low: number, high: number): number {
  return Math.max(low, Math.min(high, value));
}

/** Yields the messages of a stream of frames: a length in four bytes, big end first, then a msgpack map. */
async function* messages(stream: AsyncIterable<Buffer>): AsyncGenerator<Briefing | Observation | Ending> {
  let bytes = Buffer.alloc(0);
  for await (const chunk of stream) {
    bytes = Buffer.concat([bytes, chunk]);
    while (bytes.length >= 4 && bytes.length >= 4 + bytes.readUInt32BE()) {
      const end = 4 + bytes.readUInt32BE();
      yield decode(bytes.subarray(4, end)) as Briefing | Observation | Ending;
      bytes = bytes.subarray(end);
    }
  }
}

function send(command: Command): void {
  const payload = encode(command);
  const frame = Buffer.alloc(4 + payload.length);
  frame.writeUInt32BE(payload.length);
  frame.set(payload, 4);
  process.stdout.write(frame);
}

let beetle: DungBeetle | undefined;
for await (const message of messages(process.stdin)) {
  if (message.message === "Ending") break;
  if (message.message === "Briefing") beetle = new DungBeetle(message);
  else if (!beetle) throw new Error("expected a Briefing first");
  else if (message.awaiting_command) send(beetle.decide(message));
}
