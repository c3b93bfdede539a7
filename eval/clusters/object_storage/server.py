"""A server of object storage on this machine, and a proxy in front of it that counts bytes and can fail."""

import socket
import subprocess
import sys
import threading
import time
import urllib.request

import boto3


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Server:
    """moto, which holds everything in memory."""

    def __init__(self):
        self.port = free_port()
        command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(self.port)]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.url = f"http://127.0.0.1:{self.port}"
        for _ in range(100):
            try:
                urllib.request.urlopen(self.url).close()
                break
            except OSError:
                time.sleep(0.2)
        self.client = boto3.client(
            "s3", endpoint_url=self.url, region_name="us-east-1", aws_access_key_id="test", aws_secret_access_key="test"
        )

    def upload(self, folder, bucket, prefix):
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                self.client.upload_file(str(path), bucket, f"{prefix}/{path.relative_to(folder)}")

    def names(self, bucket, prefix):
        listed = self.client.list_objects_v2(Bucket=bucket, Prefix=prefix).get("Contents", [])
        return [entry["Key"] for entry in listed]

    def bytes(self, bucket, key):
        return self.client.get_object(Bucket=bucket, Key=key)["Body"].read()

    def check_credentials(self, requests=0):
        """From now on all requests but the next few need valid credentials, of which there are none."""
        request = urllib.request.Request(f"{self.url}/moto-api/reset-auth", data=str(requests).encode(), headers={"Content-Type": "text/plain"})
        urllib.request.urlopen(request).close()

    def stop(self):
        self.process.terminate()
        self.process.wait()


class Proxy:
    """Forwards connections to a server, and counts what it answers."""

    def __init__(self, server, dies_after=None, cuts_after=None):
        """`dies_after`: bytes of answers after which nothing answers any more; `cuts_after`: of each connection."""
        self.server, self.dies_after, self.cuts_after = server, dies_after, cuts_after
        self.answered = 0
        self.dead = False
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self.listener.getsockname()[1]}"
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            server = socket.create_connection(("127.0.0.1", self.server.port))
            threading.Thread(target=self.forward, args=(client, server, False), daemon=True).start()
            threading.Thread(target=self.forward, args=(server, client, True), daemon=True).start()

    def forward(self, source, target, is_answer):
        seen = 0
        try:
            while (data := source.recv(1 << 14)) and not self.dead:
                target.sendall(data)
                if is_answer:
                    seen += len(data)
                    self.answered += len(data)
                    self.dead = self.dead or (self.dies_after is not None and self.answered > self.dies_after)
                    if self.dead:
                        self.close()
                    if self.cuts_after is not None and seen > self.cuts_after:
                        break
        except OSError:
            pass
        for side in (source, target):
            try:
                side.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def close(self):
        self.dead = True
        try:
            self.listener.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self.listener.close()
