#!/bin/sh
# Starts the agent from any folder.
exec java -XX:TieredStopAtLevel=1 -jar "${0%/*}/target/agent.jar"
