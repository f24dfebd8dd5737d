/** The viewer's script, which comes with its own three.js. */
declare const MeshCat: any;
