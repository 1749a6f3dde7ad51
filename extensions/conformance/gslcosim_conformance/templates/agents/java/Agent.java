/* NAME: flies half a metre up the wind, again and again. Now make it find the source. */

import com.fasterxml.jackson.databind.JsonNode;
import com.fasterxml.jackson.databind.ObjectMapper;
import com.fasterxml.jackson.databind.node.ObjectNode;
import java.io.BufferedReader;
import java.io.IOException;
import java.io.InputStreamReader;
import java.nio.charset.StandardCharsets;

public class Agent {
    public static void main(String[] arguments) throws IOException {
        ObjectMapper json = new ObjectMapper();
        BufferedReader lines = new BufferedReader(new InputStreamReader(System.in, StandardCharsets.UTF_8));
        double heightM = 0;
        for (String line = lines.readLine(); line != null; line = lines.readLine()) {
            JsonNode message = json.readTree(line);
            if (message.get("message").asText().equals("Ending")) {
                break;
            } else if (message.get("message").asText().equals("Briefing")) {
                heightM = message.get("search_height_m").asDouble();
            } else if (message.get("awaiting_command").asBoolean()) {
                double upwindRad = 0;
                for (JsonNode reading : message.get("readings")) {
                    if (reading.get("sensor").asText().equals("wind")) {
                        upwindRad = reading.get("values").get(1).asDouble();
                    }
                }
                JsonNode position = message.get("position_world_m");
                ObjectNode command = json.createObjectNode().put("kind", "waypoint").set("tick", message.get("tick"));
                command.putArray("position_world_m")
                        .add(position.get(0).asDouble() + 0.5 * Math.cos(upwindRad))
                        .add(position.get(1).asDouble() + 0.5 * Math.sin(upwindRad))
                        .add(heightM);
                System.out.println(command);
            }
        }
    }
}
