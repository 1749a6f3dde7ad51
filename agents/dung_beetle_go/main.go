// Dung beetle: the reactive search of ../dung_beetle/README.md, over length-prefixed msgpack on standard input and output.
package main

import (
	"bufio"
	"encoding/binary"
	"errors"
	"fmt"
	"io"
	"log"
	"os"

	"github.com/vmihailenco/msgpack/v5"
)

// Message has the fields of Briefing, Observation and Ending that this agent reads; all others are ignored.
type Message struct {
	Message string `msgpack:"message"`

	// Briefing
	Version      string   `msgpack:"contract_version"`
	Seed         uint64   `msgpack:"seed"`
	Bounds       Bounds   `msgpack:"bounds"`
	SearchHeight float64  `msgpack:"search_height_m"`
	Sensors      []Sensor `msgpack:"sensors"`

	// Observation
	Tick            int64      `msgpack:"tick"`
	Position        [3]float64 `msgpack:"position_world_m"`
	AwaitingCommand bool       `msgpack:"awaiting_command"`
	Readings        []Reading  `msgpack:"readings"`
	Notice          *string    `msgpack:"notice"`
}

// Bounds is the room, world frame, in metres.
type Bounds struct {
	Min [3]float64 `msgpack:"min_m"`
	Max [3]float64 `msgpack:"max_m"`
}

// Sensor is one instrument of the vehicle.
type Sensor struct {
	Name  string `msgpack:"name"`
	Model string `msgpack:"model"`
	Unit  string `msgpack:"unit"`
}

// Reading is what one instrument reports.
type Reading struct {
	Sensor string    `msgpack:"sensor"`
	Values []float64 `msgpack:"values"`
}

// Command is the answer to the observation of the same tick.
type Command struct {
	Tick     int64      `msgpack:"tick"`
	Kind     string     `msgpack:"kind"`
	Position [3]float64 `msgpack:"position_world_m"`
}

// receive reads one frame: its length in four bytes, big end first, then the message.
func receive(from io.Reader) (message Message, err error) {
	var length uint32
	if err = binary.Read(from, binary.BigEndian, &length); err != nil {
		return message, err
	}
	frame := make([]byte, length)
	if _, err = io.ReadFull(from, frame); err != nil {
		return message, err
	}
	return message, msgpack.Unmarshal(frame, &message)
}

// send writes one frame.
func send(to io.Writer, command Command) error {
	payload, err := msgpack.Marshal(command)
	if err != nil {
		return err
	}
	frame := binary.BigEndian.AppendUint32(nil, uint32(len(payload)))
	_, err = to.Write(append(frame, payload...))
	return err
}

// fly answers until the run is over: an Ending, or the end of the stream between two frames.
func fly(from io.Reader, to io.Writer) error {
	var beetle *Beetle
	for {
		message, err := receive(from)
		if errors.Is(err, io.EOF) {
			return nil
		} else if err != nil {
			return fmt.Errorf("reading a message: %w", err)
		}
		switch {
		case message.Message == "Ending":
			return nil
		case message.Message == "Briefing":
			beetle, err = NewBeetle(message)
		case beetle == nil:
			return errors.New("expected a Briefing first, was " + message.Message)
		case message.AwaitingCommand:
			var command Command
			if command, err = beetle.Decide(message); err == nil {
				err = send(to, command)
			}
		}
		if err != nil {
			return err
		}
	}
}

func main() {
	log.SetFlags(0)
	log.SetPrefix("dung_beetle_go: ")
	if err := fly(bufio.NewReader(os.Stdin), os.Stdout); err != nil {
		log.Fatal(err)
	}
}
