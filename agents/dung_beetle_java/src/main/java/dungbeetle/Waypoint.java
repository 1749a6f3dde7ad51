package dungbeetle;

/** A leg to fly: the answer to the observation of the same tick. */
public record Waypoint(long tick, String kind, double[] positionWorldM) {

    public Waypoint(long tick, double xM, double yM, double zM) {
        this(tick, "waypoint", new double[] {xM, yM, zM});
    }
}
