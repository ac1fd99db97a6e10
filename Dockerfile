# `docker build -t afterglow .`, then `docker run --rm -v "$PWD:/data" afterglow room.glb --out pictures`.
FROM debian:bookworm-slim
COPY . /src
RUN /src/scripts/install_debian.sh && rm -r /src
WORKDIR /data
ENTRYPOINT ["afterglow"]
