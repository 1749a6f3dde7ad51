import socket

from gslcosim.base.sockets import short_socket_address


def test_a_socket_in_a_folder_with_a_long_name_is_reached(tmp_path):
    folder = tmp_path / ("a" * 200)
    folder.mkdir()
    path = folder / "x.sock"
    with socket.socket(socket.AF_UNIX) as listener, socket.socket(socket.AF_UNIX) as caller:
        with short_socket_address(path) as address:
            listener.bind(address)
        assert path.is_socket()
        listener.listen(1)
        with short_socket_address(path) as address:
            caller.connect(address)
        accepted, _ = listener.accept()
        accepted.close()
