package main

import (
	"fmt"
	"math"
	"strings"
)

const (
	legM            float64 = 0.8
	wallMarginM     float64 = 1.0
	rightAngleRad   float64 = 1.5707963267948966
	zigzagRad       float64 = 1.0471975511965976
	halfTurnRad     float64 = 3.141592653589793
	fullTurnRad     float64 = 6.283185307179586
	nRandomHeadings         = 100
)

// Beetle seeks gas across the wind, then zigzags up the wind; all it remembers is one reading and its side.
type Beetle struct {
	nose, vane  string
	minM, maxM  [2]float64
	heightM     float64
	randomState uint64
	lastOhm     float64 // NaN before the first reading: no reading is less gas
	side        float64 // 0 seeking, +1 zigzagging left of upwind, -1 right of it
}

// NewBeetle reads the briefing.
func NewBeetle(briefing Message) (*Beetle, error) {
	if !strings.HasPrefix(briefing.Version, "1.") {
		return nil, fmt.Errorf("expected contract version 1, was %s", briefing.Version)
	}
	beetle := &Beetle{heightM: briefing.SearchHeight, randomState: briefing.Seed, lastOhm: math.NaN()}
	for axis := range 2 {
		beetle.minM[axis] = briefing.Bounds.Min[axis] + wallMarginM
		beetle.maxM[axis] = briefing.Bounds.Max[axis] - wallMarginM
	}
	for _, sensor := range briefing.Sensors {
		if sensor.Unit == "ohm" && beetle.nose == "" {
			beetle.nose = sensor.Name
		}
		if sensor.Model == "anemometer" && beetle.vane == "" {
			beetle.vane = sensor.Name
		}
	}
	if beetle.nose == "" || beetle.vane == "" {
		return nil, fmt.Errorf("expected a gas sensor in ohm and an anemometer, the vehicle has %v", briefing.Sensors)
	}
	return beetle, nil
}

// Decide returns the next leg.
func (b *Beetle) Decide(observation Message) (Command, error) {
	ohm, err := reading(observation, b.nose, 0)
	if err != nil {
		return Command{}, err
	}
	upwindRad, err := reading(observation, b.vane, 1)
	if err != nil {
		return Command{}, err
	}
	hasMoreGas := ohm < b.lastOhm
	b.lastOhm = ohm
	if b.side == 0 && hasMoreGas {
		b.side = 1
	} else if !hasMoreGas {
		b.side = -b.side
	}
	x, y := b.nextWaypoint(observation.Position, upwindRad, observation.Notice != nil)
	return Command{Tick: observation.Tick, Kind: "waypoint", Position: [3]float64{x, y, b.heightM}}, nil
}

// nextWaypoint returns the end of the first possible leg: the rule's own, then what is left at a wall;
// without one it leaves the margin.
func (b *Beetle) nextWaypoint(start [3]float64, upwindRad float64, isBlocked bool) (x, y float64) {
	for heading := range b.headings(upwindRad, isBlocked) {
		// The conversions keep compilers from fusing multiplication and addition, which would change the last bit.
		x = toMillimetre(start[0] + float64(legM*math.Cos(heading)))
		y = toMillimetre(start[1] + float64(legM*math.Sin(heading)))
		if b.minM[0] <= x && x <= b.maxM[0] && b.minM[1] <= y && y <= b.maxM[1] {
			return x, y
		}
	}
	x = max(b.minM[0], min(b.maxM[0], start[0]))
	y = max(b.minM[1], min(b.maxM[1], start[1]))
	return toMillimetre(x), toMillimetre(y)
}

// headings yields directions in the order in which they are tried.
func (b *Beetle) headings(upwindRad float64, isBlocked bool) func(yield func(float64) bool) {
	return func(yield func(float64) bool) {
		if b.side == 0 {
			if !isBlocked && !yield(upwindRad+rightAngleRad) {
				return
			}
		} else {
			if !yield(upwindRad + float64(b.side*zigzagRad)) {
				return
			}
			b.side = -b.side
			if !yield(upwindRad+float64(b.side*zigzagRad)) || !yield(upwindRad+halfTurnRad) {
				return
			}
		}
		for range nRandomHeadings {
			if !yield(fullTurnRad * b.randomFraction()) {
				return
			}
		}
	}
}

// randomFraction returns the next random number in [0, 1), by SplitMix64.
func (b *Beetle) randomFraction() float64 {
	b.randomState += 0x9E3779B97F4A7C15
	z := b.randomState
	z = (z ^ z>>30) * 0xBF58476D1CE4E5B9
	z = (z ^ z>>27) * 0x94D049BB133111EB
	return float64((z^z>>31)>>11) / (1 << 53)
}

// reading returns one number of what the sensor of this name reports.
func reading(observation Message, sensor string, index int) (float64, error) {
	for _, item := range observation.Readings {
		if item.Sensor == sensor && index < len(item.Values) {
			return item.Values[index], nil
		}
	}
	return 0, fmt.Errorf("no reading %d of %s", index, sensor)
}

// Lengths are rounded to whole millimetres, so that the last bit of sin and cos has no effect.
func toMillimetre(lengthM float64) float64 {
	return math.Floor(float64(lengthM*1000.0)+0.5) / 1000.0
}
