package dungbeetle;

import com.fasterxml.jackson.annotation.JsonSubTypes;
import com.fasterxml.jackson.annotation.JsonSubTypes.Type;
import com.fasterxml.jackson.annotation.JsonTypeInfo;
import java.util.List;

/** What comes from the run: the fields this agent reads. All others are ignored, as the contract asks. */
@JsonTypeInfo(use = JsonTypeInfo.Id.NAME, property = "message", defaultImpl = Message.Other.class)
@JsonSubTypes({
    @Type(value = Message.Briefing.class, name = "Briefing"),
    @Type(value = Message.Observation.class, name = "Observation"),
    @Type(value = Message.Ending.class, name = "Ending")
})
public sealed interface Message {

    /** What the agent is told once, before its first observation. */
    record Briefing(String contractVersion, long seed, Bounds bounds, double searchHeightM, List<Sensor> sensors)
            implements Message {}

    /** What the agent gets in a tick; it owes a command when {@code awaitingCommand} is true. */
    record Observation(
            long tick, double[] positionWorldM, boolean awaitingCommand, List<Reading> readings, String notice)
            implements Message {

        /** Returns one number of a sensor's reading. */
        double value(String sensor, int index) {
            for (Reading reading : readings) {
                if (reading.sensor.equals(sensor)) {
                    return reading.values[index];
                }
            }
            throw new IllegalStateException("expected a reading of " + sensor + ", found none at tick " + tick);
        }
    }

    /** The run is over. */
    record Ending(String reason) implements Message {}

    /** A message that a later version of the contract may bring: to be passed over. */
    record Other() implements Message {}

    /** The room, world frame. */
    record Bounds(double[] minM, double[] maxM) {}

    /** One instrument of the vehicle. */
    record Sensor(String name, String model, String unit) {}

    /** What one instrument reports. */
    record Reading(String sensor, double[] values) {}
}
