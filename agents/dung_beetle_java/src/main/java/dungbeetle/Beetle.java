package dungbeetle;

import java.util.List;
import java.util.function.Predicate;

/**
 * Seeks gas across the wind, then zigzags up the wind; all it remembers is one reading and its side.
 *
 * <p>The rules and the exact arithmetic are those of agents/dung_beetle/README.md.
 */
public final class Beetle {
    private static final double LEG_M = 0.8;
    private static final double WALL_MARGIN_M = 1.0;
    private static final double RIGHT_ANGLE_RAD = 1.5707963267948966;
    private static final double ZIGZAG_RAD = 1.0471975511965976; // 60 degrees
    private static final double HALF_TURN_RAD = 3.141592653589793;
    private static final double FULL_TURN_RAD = 6.283185307179586;
    private static final int N_RANDOM_HEADINGS = 100;

    private final String nose;
    private final String vane;
    private final double[] minM;
    private final double[] maxM;
    private final double heightM;
    private long randomState;
    private double lastOhm = Double.NaN; // before the first reading: no reading is less than this
    private int side; // 0 seeking, +1 zigzagging left of upwind, -1 right of it

    public Beetle(Message.Briefing briefing) {
        if (!briefing.contractVersion().startsWith("1.")) {
            throw new IllegalStateException("expected contract version 1, was " + briefing.contractVersion());
        }
        nose = nameOf(briefing.sensors(), "in ohm", sensor -> sensor.unit().equals("ohm"));
        vane = nameOf(briefing.sensors(), "called anemometer", sensor -> sensor.model().equals("anemometer"));
        double[] low = briefing.bounds().minM();
        double[] high = briefing.bounds().maxM();
        minM = new double[] {low[0] + WALL_MARGIN_M, low[1] + WALL_MARGIN_M};
        maxM = new double[] {high[0] - WALL_MARGIN_M, high[1] - WALL_MARGIN_M};
        heightM = briefing.searchHeightM();
        randomState = briefing.seed();
    }

    private static String nameOf(List<Message.Sensor> sensors, String what, Predicate<Message.Sensor> isMeant) {
        return sensors.stream().filter(isMeant).findFirst().map(Message.Sensor::name)
                .orElseThrow(() -> new IllegalStateException("expected a sensor " + what + ", found none"));
    }

    /** Returns the next leg. */
    public Waypoint decide(Message.Observation seen) {
        double ohm = seen.value(nose, 0);
        double upwindRad = seen.value(vane, 1);
        boolean hasMoreGas = ohm < lastOhm;
        lastOhm = ohm;
        if (side == 0) {
            side = hasMoreGas ? 1 : 0;
        } else if (!hasMoreGas) {
            side = -side;
        }
        double[] goalM = nextWaypoint(seen, upwindRad);
        return new Waypoint(seen.tick(), goalM[0], goalM[1], heightM);
    }

    /** Returns the end of the first leg that keeps away from the walls; without one, leaves the margin. */
    private double[] nextWaypoint(Message.Observation seen, double upwindRad) {
        double[] startM = seen.positionWorldM();
        double[] goalM;
        if (side == 0) {
            if (seen.notice() == null && fits(goalM = leg(startM, upwindRad + RIGHT_ANGLE_RAD))) {
                return goalM;
            }
        } else {
            if (fits(goalM = leg(startM, upwindRad + side * ZIGZAG_RAD))) {
                return goalM;
            }
            side = -side;
            if (fits(goalM = leg(startM, upwindRad + side * ZIGZAG_RAD))
                    || fits(goalM = leg(startM, upwindRad + HALF_TURN_RAD))) {
                return goalM;
            }
        }
        for (int i = 0; i < N_RANDOM_HEADINGS; i++) {
            if (fits(goalM = leg(startM, FULL_TURN_RAD * randomFraction()))) {
                return goalM;
            }
        }
        return new double[] {insideMargin(startM[0], 0), insideMargin(startM[1], 1)};
    }

    private static double[] leg(double[] startM, double headingRad) {
        return new double[] {
            toMillimetre(startM[0] + LEG_M * Math.cos(headingRad)), toMillimetre(startM[1] + LEG_M * Math.sin(headingRad))
        };
    }

    private boolean fits(double[] goalM) {
        return minM[0] <= goalM[0] && goalM[0] <= maxM[0] && minM[1] <= goalM[1] && goalM[1] <= maxM[1];
    }

    private double insideMargin(double lengthM, int axis) {
        return toMillimetre(Math.max(minM[axis], Math.min(maxM[axis], lengthM)));
    }

    /** Returns the next random number in [0, 1), by SplitMix64, which every language can repeat exactly. */
    private double randomFraction() {
        randomState += 0x9E3779B97F4A7C15L;
        long z = (randomState ^ (randomState >>> 30)) * 0xBF58476D1CE4E5B9L;
        z = (z ^ (z >>> 27)) * 0x94D049BB133111EBL;
        return ((z ^ (z >>> 31)) >>> 11) / 9007199254740992.0;
    }

    /** Rounds to whole millimetres, so that the last bit of sin and cos has no effect. */
    private static double toMillimetre(double lengthM) {
        return Math.floor(lengthM * 1000.0 + 0.5) / 1000.0;
    }
}
