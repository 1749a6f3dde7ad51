// NAME flies half a metre up the wind, again and again. Now make it find the source.
package main

import (
	"bufio"
	"encoding/json"
	"log"
	"math"
	"os"
)

// Message has what is read of a Briefing, an Observation and an Ending; all other fields are ignored.
type Message struct {
	Message         string     `json:"message"`
	SearchHeight    float64    `json:"search_height_m"`
	Tick            int64      `json:"tick"`
	AwaitingCommand bool       `json:"awaiting_command"`
	Position        [3]float64 `json:"position_world_m"`
	Readings        []struct {
		Sensor string    `json:"sensor"`
		Values []float64 `json:"values"`
	} `json:"readings"`
}

// Command is the answer to the observation of the same tick.
type Command struct {
	Tick     int64      `json:"tick"`
	Kind     string     `json:"kind"`
	Position [3]float64 `json:"position_world_m"`
}

func main() {
	var heightM, upwindRad float64
	commands := json.NewEncoder(os.Stdout)
	messages := json.NewDecoder(bufio.NewReader(os.Stdin))
	for {
		var message Message
		if err := messages.Decode(&message); err != nil {
			log.Fatal(err)
		}
		switch {
		case message.Message == "Ending":
			return
		case message.Message == "Briefing":
			heightM = message.SearchHeight
		case message.AwaitingCommand:
			for _, reading := range message.Readings {
				if reading.Sensor == "wind" {
					upwindRad = reading.Values[1]
				}
			}
			x := message.Position[0] + 0.5*math.Cos(upwindRad)
			y := message.Position[1] + 0.5*math.Sin(upwindRad)
			if err := commands.Encode(Command{message.Tick, "waypoint", [3]float64{x, y, heightM}}); err != nil {
				log.Fatal(err)
			}
		}
	}
}
