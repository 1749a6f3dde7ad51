package dungbeetle;

import java.io.IOException;
import java.util.Optional;

/** Joins the run, answers each observation that awaits a command, and leaves. */
public final class Main {
    private Main() {}

    public static void main(String[] arguments) {
        try (Gateway gateway = Gateway.connect(System.getenv())) {
            fly(gateway);
        } catch (IOException | IllegalStateException problem) {
            System.err.println("dung_beetle_java: " + problem.getMessage());
            System.exit(1);
        }
    }

    private static void fly(Gateway gateway) throws IOException {
        Beetle beetle = null;
        Optional<Message> received;
        while ((received = gateway.receive()).isPresent()) {
            Message message = received.get();
            if (message instanceof Message.Ending) {
                return;
            } else if (message instanceof Message.Briefing briefing) {
                beetle = new Beetle(briefing);
            } else if (message instanceof Message.Observation seen && seen.awaitingCommand()) {
                gateway.send(beetle.decide(seen));
            }
        }
    }
}
