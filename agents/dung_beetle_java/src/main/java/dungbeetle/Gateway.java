package dungbeetle;

import com.fasterxml.jackson.databind.DeserializationFeature;
import com.fasterxml.jackson.databind.ObjectMapper;
import com.fasterxml.jackson.databind.PropertyNamingStrategies;
import java.io.DataInputStream;
import java.io.EOFException;
import java.io.IOException;
import java.net.InetSocketAddress;
import java.net.SocketAddress;
import java.net.UnixDomainSocketAddress;
import java.nio.ByteBuffer;
import java.nio.channels.Channels;
import java.nio.channels.SocketChannel;
import java.util.Map;
import java.util.Optional;
import org.msgpack.jackson.dataformat.MessagePackFactory;

/** A connection to the run: frames of length-prefixed msgpack over a unix socket or TCP. */
public final class Gateway implements AutoCloseable {
    private static final ObjectMapper MSGPACK = new ObjectMapper(new MessagePackFactory())
            .setPropertyNamingStrategy(PropertyNamingStrategies.SNAKE_CASE)
            .disable(DeserializationFeature.FAIL_ON_UNKNOWN_PROPERTIES);

    private final SocketChannel channel;
    private final DataInputStream input;

    private Gateway(SocketChannel channel) {
        this.channel = channel;
        this.input = new DataInputStream(Channels.newInputStream(channel));
    }

    /** Connects to the address that the run has put into the environment, and shows the token it has put there. */
    public static Gateway connect(Map<String, String> environment) throws IOException {
        String address = environment.get("GSLCOSIM_GATEWAY");
        if (address == null) {
            throw new IllegalStateException("GSLCOSIM_GATEWAY is not set; `gslcosim up` sets it with door: unix or tcp");
        }
        Gateway gateway = new Gateway(SocketChannel.open(socketAddress(address)));
        gateway.send(Map.of("token", environment.getOrDefault("GSLCOSIM_TOKEN", "")));
        return gateway;
    }

    // unix:/path or tcp:HOST:PORT
    private static SocketAddress socketAddress(String address) {
        String place = address.substring(address.indexOf(':') + 1);
        if (address.startsWith("unix:")) {
            return UnixDomainSocketAddress.of(place);
        }
        int colon = place.lastIndexOf(':');
        return new InetSocketAddress(place.substring(0, colon), Integer.parseInt(place.substring(colon + 1)));
    }

    /** Returns the next message, or nothing at the end of the stream. */
    public Optional<Message> receive() throws IOException {
        int length;
        try {
            length = input.readInt();
        } catch (EOFException end) {
            return Optional.empty();
        }
        return Optional.of(MSGPACK.readValue(input.readNBytes(length), Message.class));
    }

    /** Sends an object as one frame: the length of its map in four bytes, big end first, then the map. */
    public void send(Object fields) throws IOException {
        byte[] payload = MSGPACK.writeValueAsBytes(fields);
        ByteBuffer frame = ByteBuffer.allocate(Integer.BYTES + payload.length).putInt(payload.length).put(payload).flip();
        while (frame.hasRemaining()) {
            channel.write(frame);
        }
    }

    @Override
    public void close() throws IOException {
        channel.close();
    }
}
