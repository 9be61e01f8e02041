//! Definitions of common types: for channels of older recorders, which name a type and do not define it, and for
//! schemas that leave out a dependency.

use super::schema::Dialect;

/// The definition of `name` (`package/Type`), if it is one of the few that are built in.
pub(super) fn definition(name: &str, dialect: Dialect) -> Option<&'static str> {
    of_either(name).or_else(|| match dialect {
        Dialect::Ros1 => of_ros1(name),
        Dialect::Ros2 => of_ros2(name),
    })
}

fn of_ros1(name: &str) -> Option<&'static str> {
    Some(match name {
        "time" => "uint32 sec\nuint32 nsec",
        "duration" => "int32 sec\nint32 nsec",
        "std_msgs/Header" => "uint32 seq\ntime stamp\nstring frame_id",
        "trajectory_msgs/JointTrajectoryPoint" => {
            "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\nduration time_from_start"
        }
        _ => return None,
    })
}

fn of_ros2(name: &str) -> Option<&'static str> {
    Some(match name {
        "builtin_interfaces/Time" | "builtin_interfaces/Duration" => "int32 sec\nuint32 nanosec",
        "std_msgs/Header" => "builtin_interfaces/Time stamp\nstring frame_id",
        "trajectory_msgs/JointTrajectoryPoint" => {
            "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\nbuiltin_interfaces/Duration time_from_start"
        }
        _ => return None,
    })
}

fn of_either(name: &str) -> Option<&'static str> {
    Some(match name {
        "geometry_msgs/Point" | "geometry_msgs/Vector3" => "float64 x\nfloat64 y\nfloat64 z",
        "geometry_msgs/Pose" => "Point position\nQuaternion orientation",
        "geometry_msgs/PoseStamped" => "std_msgs/Header header\nPose pose",
        "geometry_msgs/Quaternion" => "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
        "geometry_msgs/Twist" => "Vector3 linear\nVector3 angular",
        "geometry_msgs/TwistStamped" => "std_msgs/Header header\nTwist twist",
        "geometry_msgs/Wrench" => "Vector3 force\nVector3 torque",
        "geometry_msgs/WrenchStamped" => "std_msgs/Header header\nWrench wrench",
        "sensor_msgs/JointState" => {
            "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
        }
        "std_msgs/Empty" => "",
        "std_msgs/ByteMultiArray" => "MultiArrayLayout layout\nbyte[] data",
        "std_msgs/Float32MultiArray" => "MultiArrayLayout layout\nfloat32[] data",
        "std_msgs/Float64MultiArray" => "MultiArrayLayout layout\nfloat64[] data",
        "std_msgs/Int8MultiArray" => "MultiArrayLayout layout\nint8[] data",
        "std_msgs/Int16MultiArray" => "MultiArrayLayout layout\nint16[] data",
        "std_msgs/Int32MultiArray" => "MultiArrayLayout layout\nint32[] data",
        "std_msgs/Int64MultiArray" => "MultiArrayLayout layout\nint64[] data",
        "std_msgs/UInt8MultiArray" => "MultiArrayLayout layout\nuint8[] data",
        "std_msgs/UInt16MultiArray" => "MultiArrayLayout layout\nuint16[] data",
        "std_msgs/UInt32MultiArray" => "MultiArrayLayout layout\nuint32[] data",
        "std_msgs/UInt64MultiArray" => "MultiArrayLayout layout\nuint64[] data",
        "std_msgs/MultiArrayDimension" => "string label\nuint32 size\nuint32 stride",
        "std_msgs/MultiArrayLayout" => "MultiArrayDimension[] dim\nuint32 data_offset",
        "trajectory_msgs/JointTrajectory" => {
            "std_msgs/Header header\nstring[] joint_names\nJointTrajectoryPoint[] points"
        }
        _ => return None,
    })
}
