// A ROS 2 peer in Rust: the graph, a topic of a run, a service and an action of gslcosim_ros, and a topic of its own.
use std::time::Duration;

use hiroz::{context::ZContextBuilder, Builder, Result};
use hiroz_msgs::action_tutorials_interfaces::{action::Fibonacci, FibonacciGoal};
use hiroz_msgs::example_interfaces::{srv::AddTwoInts, AddTwoIntsRequest};
use hiroz_msgs::nav_msgs::Odometry;
use hiroz_msgs::std_msgs::String as RosString;

#[tokio::main]
async fn main() -> Result<()> {
    let endpoint = std::env::args().nth(1).expect("endpoint");
    let ctx = ZContextBuilder::default()
        .with_mode("client")
        .with_connect_endpoints([endpoint.as_str()])
        .build()?;
    let node = ctx.create_node("hiroz_peer").build()?;
    let publisher = node.create_pub::<RosString>("/from_hiroz").build()?;
    let client = node.create_client::<AddTwoInts>("/add_two_ints").build()?;
    let fibonacci = node.create_action_client::<Fibonacci>("/fibonacci").build()?;
    let odometry = node.create_sub::<Odometry>("/beetle/odom").build()?;
    tokio::time::sleep(Duration::from_secs(2)).await;
    for (name, kind) in node.graph().get_topic_names_and_types() {
        println!("topic {name} {kind}");
    }
    for (name, namespace) in node.graph().get_node_names() {
        println!("node {namespace} {name}");
    }
    for (name, kind) in node.graph().get_service_names_and_types() {
        println!("service {name} {kind}");
    }
    publisher.publish(&RosString { data: "from hiroz".to_string() })?;
    let sum = client
        .call_with_timeout(&AddTwoIntsRequest { a: 19, b: 23 }, Duration::from_secs(10))
        .await?;
    println!("sum {}", sum.sum);
    let mut goal = fibonacci.send_goal(FibonacciGoal { order: 6 }).await?;
    if let Some(mut feedback) = goal.feedback() {
        tokio::spawn(async move {
            while let Some(one) = feedback.recv().await {
                println!("feedback {:?}", one.partial_sequence);
            }
        });
    }
    let result = tokio::time::timeout(Duration::from_secs(30), goal.result()).await??;
    println!("result {:?}", result.sequence);
    for _ in 0..3 {
        let one = odometry.recv()?;
        println!("odom {} {:.4}", one.header.frame_id, one.pose.pose.position.x);
    }
    println!("done");
    Ok(())
}
